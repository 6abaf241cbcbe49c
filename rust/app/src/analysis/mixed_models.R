# Mixed and ordinal models of the tables beside this script, by the packages lme4 and ordinal.
#
#   Rscript mixed_models.R [FOLDER]
#
# reads data/trials.csv, data/objects.csv and data/answers.csv in FOLDER (by default this one) and writes
# tables/mixed_models.csv. Each model has the method as fixed effect, beside the first by name, and an intercept for each
# participant at random:
#
#   score          linear (lmer) and cumulative logit (clmm), with the number of the trial as learning
#   pick, place    linear, of the logarithm of seconds
#   each rating    cumulative logit
#
# p is of Wald's z, which is too small with few participants: read it beside the exact tests of the report. A model that does not
# converge or is singular says so in the column note, and its figures are then no evidence.

folder <- commandArgs(trailingOnly = TRUE)
folder <- if (length(folder) > 0) folder[[1]] else "."
suppressPackageStartupMessages({
  library(lme4)
  library(ordinal)
})

table_of <- function(name) {
  path <- file.path(folder, "data", paste0(name, ".csv"))
  if (!file.exists(path)) return(NULL)
  rows <- read.csv(path, na.strings = "", stringsAsFactors = FALSE)
  if (nrow(rows) == 0) NULL else rows
}

found <- list()

fit <- function(measure, model, rows, columns, make) {
  rows <- rows[complete.cases(rows[columns]), ]
  rows$condition <- factor(rows$condition)
  rows$participant <- factor(rows$participant)
  notes <- character()
  n <- nrow(rows)
  people <- nlevels(droplevels(rows$participant))
  entry <- function(term = "", estimate = NA, se = NA, note = "") {
    z <- estimate / se
    found[[length(found) + 1]] <<- data.frame(
      measure = measure, model = model, term = term, estimate = estimate, se = se, z = z,
      p = 2 * pnorm(-abs(z)), n = n, participants = people, note = note
    )
  }
  if (people < 2 || nlevels(droplevels(rows$condition)) < 2) {
    return(entry(note = "needs two participants and two methods"))
  }
  fitted <- tryCatch(
    withCallingHandlers(make(rows),
      warning = function(w) { notes <<- c(notes, conditionMessage(w)); invokeRestart("muffleWarning") },
      message = function(m) { notes <<- c(notes, trimws(conditionMessage(m))); invokeRestart("muffleMessage") }
    ),
    error = function(e) { notes <<- c(notes, conditionMessage(e)); NULL }
  )
  note <- paste(unique(notes), collapse = "; ")
  if (is.null(fitted)) return(entry(note = note))
  estimates <- coef(summary(fitted))
  for (term in grep("^condition|^trial", rownames(estimates), value = TRUE)) {
    entry(sub("^condition", "", term), estimates[term, 1], estimates[term, 2], note)
  }
}

trials <- table_of("trials")
if (!is.null(trials)) {
  trials$trial <- suppressWarnings(as.numeric(trials$trial))
  columns <- c("score", "condition", "participant", "trial")
  several <- length(unique(na.omit(trials$trial))) > 1
  formula_of <- function(left) as.formula(paste(left, "~ condition", if (several) "+ trial", "+ (1 | participant)"))
  fit("score", "linear", trials, columns, function(rows) lmer(formula_of("score"), rows))
  fit("score", "cumulative logit", trials, columns, function(rows) {
    rows$score <- ordered(rows$score)
    clmm(formula_of("score"), data = rows)
  })
}

objects <- table_of("objects")
if (!is.null(objects)) {
  for (column in c("pick_s", "place_s")) {
    rows <- objects
    rows$seconds <- rows[[column]]
    fit(sub("_s$", "", column), "linear, log of seconds", rows, c("seconds", "condition", "participant"), function(rows) {
      lmer(log(seconds) ~ condition + (1 | participant), rows[rows$seconds > 0, ])
    })
  }
}

answers <- table_of("answers")
if (!is.null(answers)) {
  answers$value <- suppressWarnings(as.numeric(answers$answer))
  rated <- answers[!is.na(answers$value) & !is.na(answers$condition), ]
  for (name in unique(paste(rated$form, rated$item, sep = ": "))) {
    rows <- rated[paste(rated$form, rated$item, sep = ": ") == name, ]
    fit(name, "cumulative logit", rows, c("value", "condition", "participant"), function(rows) {
      rows$value <- ordered(rows$value)
      clmm(value ~ condition + (1 | participant), data = rows)
    })
  }
}

dir.create(file.path(folder, "tables"), showWarnings = FALSE)
out <- if (length(found) > 0) do.call(rbind, found) else data.frame()
write.csv(out, file.path(folder, "tables", "mixed_models.csv"), row.names = FALSE, na = "")
