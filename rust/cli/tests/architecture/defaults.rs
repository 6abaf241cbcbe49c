//! What was read never falls back to a default: a result, an outcome, a row or a key that cannot be read is an error.

use crate::workspace::files;

/// What reads a text, a number or a value out of data.
const READS: [&str; 12] = [
    ".parse()",
    ".parse::<",
    "from_str(",
    "from_slice(",
    "from_value(",
    "from_reader(",
    "from_str_radix(",
    "to_value(",
    "read_result",
    "Value::as_",
    "\"].as_",
    "object_results(",
];
/// What then hides that it could not be read.
const FALLBACKS: [&str; 7] = [
    "unwrap_or_default()",
    "unwrap_or(",
    "unwrap_or_else(|_|",
    ".ok()",
    "map_or(",
    "map_or_else(|_|",
    ".is_ok_and(",
];
/// Crates whose files are no part of the product.
const NOT_THE_PRODUCT: [&str; 2] = ["rust/fuzz/", "rust/bench/"];
/// What reads results, tables, journals and configurations: here a default needs its reason wherever it stands.
const READERS: [&str; 5] = [
    "rust/app/src/analysis/",
    "rust/app/src/batch/",
    "rust/app/src/study/",
    "rust/recording/src/",
    "rust/study/src/",
];

const AN_ERROR: &str = "nothing becomes an error where it is called";
const OWN: &str = "what the same command has just written";
const ANSWERED: &str = "whoever asks gets the answer `no`, and nothing is read";
const ABSENT: &str = "what was not given has this value by its documentation; nothing was read";

/// Files with a piece of a statement that may stay, and why.
const ALLOWED: &[(&str, &str, &str)] = &[
    (
        "rust/devices/src/metadata/rate_names.rs",
        "text.trim().trim_end_matches(|c: char| !c.is_ascii_digit()).parse().ok()",
        "a text that is no number is no rate; this looks for rates under unknown keys",
    ),
    (
        "rust/analysis/src/table.rs",
        "words.parse().ok()",
        "a person may answer in words; tables that are read are checked before",
    ),
    (
        "rust/app/src/analysis/leader_board.rs",
        "compare_conditions(&scores, seed).pairs",
        "a single method has no pairs",
    ),
    ("rust/app/src/analysis/report.rs", "dir.file_stem()", "a title, of a folder without a name"),
    (
        "rust/app/src/analysis/scores.rs",
        "digits.parse().ok()",
        "a bag of the original has what its name says, and no more",
    ),
    (
        "rust/app/src/analysis/summaries.rs",
        "digits.parse().unwrap_or(u64::MAX)",
        "names without a number come last",
    ),
    (
        "rust/app/src/analysis/sweeps.rs",
        "cell.parse().map_or_else",
        "a cell that the table made here left empty",
    ),
    ("rust/app/src/batch/folder.rs", "number.parse().ok()", AN_ERROR),
    (
        "rust/app/src/batch/folder.rs",
        "serde_json::from_slice(json).ok()",
        "a damaged line is counted, told and run again",
    ),
    ("rust/app/src/batch/slurm.rs", "text.trim().split(';')", "the first part of a text is always there"),
    ("rust/app/src/batch/trial_list.rs", "common.instruction", ABSENT),
    ("rust/app/src/batch/trial_list.rs", "arm.pinned().hash", ABSENT),
    ("rust/app/src/fit/prediction.rs", "u64::from_str_radix(part, 16).ok()", AN_ERROR),
    ("rust/app/src/study/simulated_participant.rs", "choices[condition].instruction", ABSENT),
    ("rust/app/src/study/rehearsal.rs", "history.unwrap_or_default()", "a trial without trials before it"),
    (
        "rust/app/src/study/tables/armsym.rs",
        "data.times.last()",
        "the end of a trial without events is its start",
    ),
    ("rust/app/src/study/live.rs", "id.unwrap_or_default()", "a place that nobody has yet"),
    ("rust/app/src/study/live/arm_activities.rs", "rest.unwrap_or_default()", ABSENT),
    ("rust/app/src/study/live/screen.rs", "schedule_deviation(", "a session that departs from nothing"),
    (
        "rust/app/src/study/live/steps.rs",
        "plan.texts.get(text)",
        "a plan that names a text which it lacks is refused when it is read",
    ),
    ("rust/app/src/study/live/steps.rs", "planned.into_iter().next()", "a session without steps"),
    ("rust/app/src/tracked_body.rs", "value.parse::<f64>().ok()", AN_ERROR),
    ("rust/app/src/trunk_log.rs", "cell.parse().ok()", AN_ERROR),
    ("rust/cli/src/emg/decoder_args.rs", "name.parse().ok()?", AN_ERROR),
    ("rust/cli/src/emg/usability.rs", "report[\"mistakes\"]", OWN),
    ("rust/cli/src/emg/usability.rs", "report[\"model\"]", OWN),
    ("rust/cli/src/emg/usability/virtual_limb.rs", "report[\"completion_rate\"]", OWN),
    ("rust/cli/src/emg/training_output.rs", "object[\"model\"]", OWN),
    (
        "rust/cli/src/interrupt.rs",
        "u64::from_str_radix",
        "what the kernel does not say is as in a shell: no signal is ignored",
    ),
    ("rust/description/src/srdf.rs", "text.trim().parse().ok()", AN_ERROR),
    (
        "rust/description/src/settings.rs",
        "toml::from_str(text)",
        "the same text is read again for its settings, and refused there",
    ),
    ("rust/devices/src/feedback/vibration.rs", "text.parse().ok()", AN_ERROR),
    (
        "rust/devices/src/gforce/simulator.rs",
        "name.parse().ok()",
        "a simulator for tests: what it does not understand is no prompt",
    ),
    ("rust/devices/src/libemg.rs", "word.parse().ok()", AN_ERROR),
    ("rust/devices/src/metadata.rs", "class.parse().ok()", AN_ERROR),
    ("rust/devices/src/metadata.rs", "name.parse::<Gesture>().ok()?", "names in this program's own source"),
    (
        "rust/devices/src/myo/simulator.rs",
        "name.parse().ok()",
        "a simulator for tests: what it does not understand is no prompt",
    ),
    ("rust/devices/src/recorder/csv.rs", "text.parse::<f64>().ok()", AN_ERROR),
    ("rust/devices/src/recorder/edf.rs", "text.trim().parse::<f64>().ok()", AN_ERROR),
    ("rust/devices/src/recorder/edf.rs", "text.parse::<f64>().ok()", AN_ERROR),
    (
        "rust/devices/src/recording.rs",
        "repetition.parse().ok()?",
        "a file of another name is none of a recording",
    ),
    ("rust/devices/src/sources.rs", "self.address().parse().ok()", AN_ERROR),
    ("rust/http/src/access.rs", "ours.parse().ok()", ANSWERED),
    ("rust/http/src/access.rs", "name.parse::<IpAddr>()", ANSWERED),
    ("rust/http/src/guard.rs", "HeaderValue::as_bytes", "a response without a type"),
    ("rust/http/src/guard.rs", "HeaderValue::from_str(&policy)", "the strictest policy"),
    (
        "rust/messages/src/cbor.rs",
        "serde_json::to_value(value)",
        "a number that JSON lacks is null there, as rosbridge has it",
    ),
    ("rust/messages/src/definition.rs", "digits.parse().ok()", AN_ERROR),
    ("rust/recording/src/bag/records.rs", "field.split(", "the first part of a text is always there"),
    (
        "rust/recording/src/bag/trial_bag.rs",
        "arm.links.first()",
        "an arm without links is refused when it is read",
    ),
    (
        "rust/recording/src/bag/trial_bag.rs",
        "self.objects.get(object.index())",
        "an object of the scene of this very trial",
    ),
    ("rust/recording/src/xdf.rs", "stream.span", "a stream without samples begins and ends at zero"),
    (
        "rust/ros/src/node/tcp_nodelay.rs",
        "name.parse::<i32>().ok()",
        "a file of the kernel's of another name is no descriptor",
    ),
    ("rust/rosbridge/src/actions.rs", "status[\"text\"]", "messages have the fields of their type"),
    ("rust/rosbridge/src/actions.rs", "message[\"status_list\"]", "messages have the fields of their type"),
    ("rust/rosbridge/src/headset_input.rs", "value.get(\"", "messages have the fields of their type"),
    ("rust/study/src/answers.rs", "text.trim().parse()", "what is no number was answered in words"),
    ("rust/study/src/counterbalance.rs", "trial.arrangement.clone()", ABSENT),
    ("rust/study/src/progress.rs", "self.steps.get(step_id)", "what was never begun"),
    (
        "rust/types/src/gesture.rs",
        "self.as_str().parse().ok()",
        "a gesture of another name is none of the five",
    ),
];

/// The statements of a file without its tests, each with the number of its first line.
fn statements(text: &str) -> Vec<(usize, String)> {
    let code = text.split("#[cfg(test)]").next().unwrap_or_default();
    let mut found = Vec::new();
    let (mut start, mut statement) = (1, String::new());
    for (number, line) in (1..).zip(code.lines()) {
        let line = line.split("//").next().unwrap_or_default().trim();
        if statement.is_empty() {
            start = number;
        }
        statement.push_str(line);
        let goes_on = !line.ends_with([';', '{', '}']);
        if !goes_on {
            found.push((start, std::mem::take(&mut statement)));
        }
    }
    found.push((start, statement));
    found
}

/// Whether a statement reads something and then goes on without it, or, in a file that `reads`, has a default at all.
fn falls_back(statement: &str, reads: bool) -> bool {
    // This one keeps the error.
    let statement = statement.replace("map_or(Ok(", "");
    let read = READS.iter().filter_map(|form| statement.find(form)).min();
    let hidden = read.is_some_and(|at| FALLBACKS.iter().any(|form| statement[at..].contains(form)));
    hidden || reads && statement.contains("unwrap_or_default()")
}

#[test]
fn what_was_read_never_falls_back_to_a_default() {
    let (mut violations, mut used) = (Vec::new(), vec![false; ALLOWED.len()]);
    let product = |path: &str| {
        path.starts_with("rust/")
            && path.contains("/src/")
            && path.ends_with(".rs")
            && !path.ends_with("tests.rs")
            && !NOT_THE_PRODUCT.iter().any(|folder| path.starts_with(folder))
    };
    for (path, text) in files().iter().filter(|(path, _)| product(path)) {
        let reads = READERS.iter().any(|folder| path.starts_with(folder));
        for (number, statement) in statements(text).into_iter().filter(|(_, own)| falls_back(own, reads)) {
            let allowed =
                (0..).zip(ALLOWED).filter(|(_, (file, piece, _))| path == file && statement.contains(piece));
            let indices: Vec<usize> = allowed.map(|(index, _)| index).collect();
            if indices.is_empty() {
                violations.push(format!("{path}:{number}: {statement}"));
            }
            indices.into_iter().for_each(|index| used[index] = true);
        }
    }
    let stale = ALLOWED
        .iter()
        .zip(&used)
        .filter(|(_, used)| !**used)
        .map(|((file, piece, _), _)| format!("{file}: {piece}"));
    let stale: Vec<String> = stale.collect();
    assert!(
        violations.is_empty() && stale.is_empty(),
        "return an error that names what cannot be read, or give the reason in ALLOWED:\n{}\nno longer there, take out of ALLOWED:\n{}",
        violations.join("\n"),
        stale.join("\n")
    );
}

#[test]
fn a_fallback_after_reading_is_told_from_one_that_reads_nothing() {
    for bad in [
        "let rows: Vec<Row> = serde_json::from_value(lines.clone()).unwrap_or_default();",
        "let score = text.parse().unwrap_or(0.0);",
        "let name = value.and_then(Value::as_str).map_or(\"\", str::trim);",
        "let n = word.parse::<u32>().ok();",
    ] {
        assert!(falls_back(bad, false), "{bad}");
    }
    for good in [
        "let score: f64 = text.parse().map_err(|_| wrong(text))?;",
        "let name = option.map_or(Ok(1), |text| text.parse())?;",
        "let first = names.first().cloned().unwrap_or_default();",
    ] {
        assert!(!falls_back(good, false), "{good}");
    }
    assert!(falls_back("let first = names.first().cloned().unwrap_or_default();", true));
    // Over several lines, and not in tests or comments.
    let text = "fn f() {\n    let rows = serde_json::from_str(text)\n        .ok()\n        .unwrap_or_default(); // .ok()\n}\n\
                #[cfg(test)]\nmod tests { fn g() { text.parse().ok(); } }\n";
    let found: Vec<usize> = statements(text)
        .into_iter()
        .filter(|(_, own)| falls_back(own, false))
        .map(|(number, _)| number)
        .collect();
    assert_eq!(found, [2]);
}
