use crate::{PlannedTrial, Schedule, SessionItem, StudyPlan};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

/// How far a schedule is from balanced, and how long it takes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CounterbalanceReport {
    /// Pairs of factors whose levels do not meet equally often, though they could.
    pub imbalances: Vec<Imbalance>,
    /// Pairs that are as balanced as the numbers allow.
    pub balanced: Vec<Imbalance>,
    /// Factors that tell each other's level: what one does cannot be told from what the other does.
    #[serde(rename = "confounded")]
    pub confounds: Vec<Confound>,
    /// How long each session takes at most.
    pub minutes_per_session: Vec<SessionMinutes>,
}

/// How often the levels of two factors meet.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Imbalance {
    /// Such as `condition`.
    pub factor_a: &'static str,
    /// Such as `position`.
    pub factor_b: &'static str,
    /// Largest less smallest count; where arrangements are one factor, of the arrangement for which that is most, so that one that
    /// is used often is not held against the other factor.
    pub size: u64,
    /// The least size that these numbers allow.
    pub possible: u64,
    /// What is counted: `participants`, `trials` or `times`.
    pub unit: &'static str,
    /// Where the counts are smallest and largest, for a reader.
    pub detail: String,
}

/// Two factors of which the first tells the second.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Confound {
    /// Its level tells ..
    pub factor: &'static str,
    /// .. that of this one.
    #[serde(rename = "tells")]
    pub determines: &'static str,
    /// For a reader.
    pub detail: String,
}

/// How long a session takes if every trial lasts until its limit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SessionMinutes {
    /// Its name.
    pub session: String,
    /// Of the participant for whom it takes longest.
    pub minutes: f64,
    /// Trials and what lies between them.
    #[serde(rename = "of_trials")]
    pub trial_minutes: f64,
    /// How many.
    pub trials: usize,
}

/// The factor of succession.
const PREVIOUS: &str = "previous condition";

/// A level for a reader; a number alone says little.
fn level_label(factor: &str, level: &str) -> String {
    if level.starts_with(|c: char| c.is_ascii_digit()) {
        format!("{factor} {level}")
    } else {
        level.to_owned()
    }
}

/// Counts of meetings of the levels of two factors, all of which are listed.
struct ContingencyTable {
    /// As they are told.
    names: (&'static str, &'static str),
    /// That of `a`, and that of `b`.
    factors: (&'static str, &'static str),
    unit: &'static str,
    a: Vec<String>,
    b: Vec<String>,
    counts: Vec<u64>,
    /// Meetings that cannot be, such as of a condition with itself.
    excluded_cells: BTreeSet<usize>,
    /// Counts are compared within each level of the second factor.
    compare_within_columns: bool,
}

impl ContingencyTable {
    fn new(names: (&'static str, &'static str), unit: &'static str, a: Vec<String>, b: Vec<String>) -> Self {
        let counts = vec![0; a.len() * b.len()];
        Self {
            names,
            factors: names,
            unit,
            a,
            b,
            counts,
            excluded_cells: BTreeSet::new(),
            compare_within_columns: false,
        }
    }

    fn count_pair(&mut self, a: &str, b: &str) {
        let level_index = |levels: &[String], level: &str| levels.iter().position(|other| other == level);
        if let (Some(a), Some(b)) = (level_index(&self.a, a), level_index(&self.b, b)) {
            self.counts[a * self.b.len() + b] += 1;
        }
    }

    fn cells(&self) -> impl Iterator<Item = (usize, u64)> {
        self.counts.iter().copied().enumerate().filter(|(k, _)| !self.excluded_cells.contains(k))
    }

    /// Cells whose counts are compared with each other.
    fn compared_groups(&self) -> Vec<Vec<(usize, u64)>> {
        if !self.compare_within_columns {
            return vec![self.cells().collect()];
        }
        let width = self.b.len();
        (0..width).map(|b| self.cells().filter(|(k, _)| k % width == b).collect()).collect()
    }

    fn imbalance(&self) -> Option<Imbalance> {
        let spread = |cells: &[(usize, u64)]| {
            let counts = || cells.iter().map(|cell| cell.1);
            Some((counts().min()?, counts().max()?))
        };
        let groups = self.compared_groups();
        // The first of those with the largest size.
        let worst = groups.iter().rev().max_by_key(|cells| spread(cells).map(|(min, max)| max - min))?;
        let (min, max) = spread(worst)?;
        let even = |cells: &[(usize, u64)]| {
            cells.iter().map(|cell| cell.1).sum::<u64>().is_multiple_of(cells.len().max(1) as u64)
        };
        let possible = u64::from(!groups.iter().all(|cells| even(cells)));
        let of = |count: u64| {
            let all: Vec<String> = worst
                .iter()
                .filter(|cell| cell.1 == count)
                .map(|(k, _)| match &self.b[..] {
                    [_] => self.a[*k].clone(),
                    b => {
                        let between = if self.factors.1 == PREVIOUS { "after" } else { "with" };
                        let (a, b) = (&self.a[k / b.len()], &b[k % b.len()]);
                        format!(
                            "{} {between} {}",
                            level_label(self.factors.0, a),
                            level_label(self.factors.1, b)
                        )
                    }
                })
                .collect();
            match &all[..] {
                [one, two, rest @ ..] if !rest.is_empty() => format!("{one}; {two}; {} more", rest.len()),
                few => few.join("; "),
            }
        };
        let detail = match (min == max, self.compare_within_columns) {
            (true, false) => format!("each {max} {}", self.unit),
            (true, true) => "each as often as the others".to_owned(),
            _ => format!("{min} {} ({}) to {max} ({})", self.unit, of(min), of(max)),
        };
        let (factor_a, factor_b) = self.names;
        Some(Imbalance { factor_a, factor_b, size: max - min, possible, unit: self.unit, detail })
    }

    /// Whether each level of the first has met one level of the second alone, of several.
    fn first_determines_second(&self) -> bool {
        let width = self.b.len();
        let met = |row: usize| (0..width).filter(|b| self.counts[row * width + b] > 0).count();
        let columns =
            (0..width).filter(|b| (0..self.a.len()).any(|a| self.counts[a * width + b] > 0)).count();
        columns > 1 && (0..self.a.len()).all(|row| met(row) <= 1)
    }
}

/// Levels in the order of their first appearance.
fn levels(of: impl Iterator<Item = String>) -> Vec<String> {
    let mut found = Vec::new();
    for level in of {
        if !found.contains(&level) {
            found.push(level);
        }
    }
    found
}

/// What a trial has of each factor.
fn level(trial: &PlannedTrial, factor: &str) -> String {
    match factor {
        "condition" => trial.condition.clone(),
        "position" => trial.position.to_string(),
        "session" => trial.session.clone(),
        "participant" => trial.participant.to_string(),
        "trial" => trial.trial.to_string(),
        _ => trial.arrangement.clone().unwrap_or_default(),
    }
}

/// Pairs of factors that are crossed, trial by trial.
const TRIAL_PAIRS: &[(&str, &str)] = &[
    ("condition", "session"),
    ("condition", "arrangement"),
    ("participant", "arrangement"),
    ("position", "arrangement"),
    ("trial", "arrangement"),
    ("session", "arrangement"),
];

/// Pairs of which the first may tell the second.
const CONFOUND_PAIRS: &[(&str, &str)] = &[
    ("condition", "position"),
    ("position", "condition"),
    ("condition", "session"),
    ("session", "condition"),
    ("participant", "condition"),
    ("condition", "participant"),
    ("trial", "arrangement"),
    ("arrangement", "trial"),
    ("arrangement", "condition"),
    ("condition", "arrangement"),
    ("arrangement", "participant"),
    ("participant", "arrangement"),
    ("arrangement", "position"),
    ("position", "arrangement"),
    ("arrangement", "session"),
];

impl CounterbalanceReport {
    /// Of a plan's own schedule; `arrangements` as it was made with.
    pub fn of(plan: &StudyPlan, schedule: &Schedule, arrangements: &[String]) -> Self {
        let trials: Vec<&PlannedTrial> = schedule.trials().collect();
        let crossing = |a: &'static str, b: &'static str| {
            let all = |factor: &str| levels(trials.iter().map(|trial| level(trial, factor)));
            let mut crossing = ContingencyTable::new((a, b), "trials", all(a), all(b));
            for trial in &trials {
                crossing.count_pair(&level(trial, a), &level(trial, b));
            }
            crossing
        };
        let has_arrangements = plan.arrangements.is_some();
        let concerns = |pair: &&(&'static str, &'static str)| {
            has_arrangements || (pair.0 != "arrangement" && pair.1 != "arrangement")
        };
        let several_sessions = levels(trials.iter().map(|trial| trial.session.clone())).len() > 1;
        let mut found = condition_order_tables(plan, &trials);
        if has_arrangements {
            found.push(arrangement_usage(arrangements, &trials));
        }
        for &(a, b) in TRIAL_PAIRS.iter().filter(concerns) {
            if several_sessions || (a != "session" && b != "session") {
                let within = b == "arrangement";
                let names = if within && a != "condition" { (b, a) } else { (a, b) };
                found.push(ContingencyTable { compare_within_columns: within, names, ..crossing(a, b) });
            }
        }
        let (imbalances, balanced) = found
            .iter()
            .filter_map(ContingencyTable::imbalance)
            .partition(|found| found.size > found.possible);
        let confound = CONFOUND_PAIRS
            .iter()
            .filter(concerns)
            .filter(|(a, b)| crossing(a, b).first_determines_second())
            .map(|&(factor, determined)| Confound {
                factor,
                determines: determined,
                detail: format!("each {factor} has one {determined} alone"),
            })
            .collect();
        Self { imbalances, balanced, confounds: confound, minutes_per_session: minutes(plan, schedule) }
    }
}

/// Conditions by their place in the participants' orders, and by what they follow.
fn condition_order_tables(plan: &StudyPlan, trials: &[&PlannedTrial]) -> Vec<ContingencyTable> {
    let names: Vec<String> = plan.conditions.iter().map(|condition| condition.name.clone()).collect();
    let positions = (1..=names.len()).map(|number| number.to_string()).collect();
    let mut by_position =
        ContingencyTable::new(("condition", "position"), "participants", names.clone(), positions);
    let mut by_succession =
        ContingencyTable::new(("condition", PREVIOUS), "times", names.clone(), names.clone());
    by_succession.excluded_cells = (0..names.len()).map(|k| k * names.len() + k).collect();
    let mut orders: BTreeMap<usize, BTreeMap<usize, &str>> = BTreeMap::new();
    for trial in trials {
        orders.entry(trial.participant).or_default().insert(trial.position, &trial.condition);
    }
    for order in orders.values() {
        for (position, condition) in order {
            by_position.count_pair(condition, &position.to_string());
            if let Some(before) = order.get(&(position - 1)) {
                by_succession.count_pair(condition, before);
            }
        }
    }
    if names.len() < 2 {
        return Vec::new();
    }
    vec![by_position, by_succession]
}

/// How often each of the arrangements that there are is used.
fn arrangement_usage(arrangements: &[String], trials: &[&PlannedTrial]) -> ContingencyTable {
    let any = vec!["any trial".to_owned()];
    let mut used = ContingencyTable::new(("arrangement", "use"), "trials", arrangements.to_vec(), any);
    for trial in trials {
        used.count_pair(&level(trial, "arrangement"), "any trial");
    }
    used
}

fn minutes(plan: &StudyPlan, schedule: &Schedule) -> Vec<SessionMinutes> {
    let limit = |trial: &PlannedTrial| plan.limit_secs(trial) / 60.0;
    let of_session = |session: &crate::PlannedSession| {
        let mut max_minutes =
            SessionMinutes { session: session.name.clone(), minutes: 0.0, trial_minutes: 0.0, trials: 0 };
        for visit in schedule.sessions.iter().filter(|visit| visit.session == session.name) {
            let (mut steps, mut of_trials, mut trials) = (0.0, 0.0, 0);
            for item in &visit.items {
                match item {
                    SessionItem::Step(planned) => steps += planned.step.minutes(),
                    SessionItem::Trial(trial) => {
                        of_trials += limit(trial) + session.between_trials_minutes;
                        trials += 1;
                    }
                }
            }
            if steps + of_trials > max_minutes.minutes {
                max_minutes = SessionMinutes {
                    minutes: steps + of_trials,
                    trial_minutes: of_trials,
                    trials,
                    ..max_minutes
                };
            }
        }
        max_minutes
    };
    plan.sessions.iter().map(of_session).collect()
}
