//! Every statistic beside SciPy and statsmodels, on 200 random data sets with ties, missing values and few people.
#![allow(clippy::unwrap_used)]
#![allow(clippy::disallowed_methods)] // It starts another program.

use proact_analysis::statistics::{
    PValueMethod, RepeatedMeasures, StatisticsError, Wilcoxon, bca_interval, friedman, holm,
    paired_permutation, skewness_test, wilcoxon, wilcoxon_of_pairs,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};
use std::{
    io::Write,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

/// Both sides work in double precision; distributions are the least exact.
const TOLERANCE: f64 = 1e-6;

/// A Python with SciPy and statsmodels, or none with a message.
fn peers() -> Option<PathBuf> {
    let checkout = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../build/peers");
    let fetched = std::env::var_os("PROACT_PEERS").map_or(checkout, PathBuf::from).join("bin/python3");
    let has = |python: &PathBuf| {
        let output = Command::new(python).args(["-c", "import scipy, statsmodels"]).output();
        output.is_ok_and(|output| output.status.success())
    };
    let found = [fetched, PathBuf::from("/usr/bin/python3")].into_iter().find(has);
    if found.is_none() {
        println!("skipped: SciPy and statsmodels not found; ./proact test statistics installs them");
    }
    found
}

struct DataSet {
    rows: Vec<Vec<Option<f64>>>,
    chances: Vec<f64>,
}

fn data_set(number: u64) -> DataSet {
    let mut rng = ChaCha8Rng::seed_from_u64(number);
    let people = match number % 5 {
        0 => rng.random_range(1..4),
        1 => rng.random_range(3..7),
        2 => rng.random_range(6..13),
        3 => rng.random_range(12..40),
        _ => rng.random_range(51..90),
    };
    let conditions = rng.random_range(3..6);
    let ties = rng.random_bool(0.5);
    let missing = if rng.random_bool(0.4) { 0.15 } else { 0.0 };
    let rows = (0..people)
        .map(|_| {
            let skill = rng.random_range(0.0..3.0);
            (0..conditions)
                .map(|condition| {
                    let value: f64 = skill + 0.3 * f64::from(condition) + rng.random_range(-2.0..2.0);
                    (!rng.random_bool(missing)).then_some(if ties { value.round() } else { value })
                })
                .collect()
        })
        .collect();
    let tests = rng.random_range(1..7);
    DataSet { rows, chances: (0..tests).map(|_| rng.random_range(0.0_f64..1.0).powi(3)).collect() }
}

/// What the peers say of each data set.
fn ask(python: &Path, sets: &[DataSet]) -> Vec<Value> {
    let program =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/side_by_side/statistics/scipy_peer.py");
    let lines: String =
        sets.iter().map(|s| format!("{}\n", json!({"rows": s.rows, "chances": s.chances}))).collect();
    let mut command = Command::new(python);
    let mut peer = command.arg(program).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    let mut input = peer.stdin.take().unwrap();
    let output = std::thread::scope(|scope| {
        scope.spawn(move || input.write_all(lines.as_bytes()).unwrap());
        peer.wait_with_output().unwrap()
    });
    assert!(output.status.success());
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

fn near(what: &str, ours: f64, theirs: &Value) {
    let theirs = theirs.as_f64().unwrap_or_else(|| panic!("{what}: {theirs}"));
    assert!(
        (ours - theirs).abs() <= TOLERANCE * theirs.abs().max(1.0),
        "{what}: {ours} here, {theirs} there"
    );
}

/// How often each kind of answer was compared.
#[derive(Debug, Default)]
struct Compared {
    friedman: usize,
    friedman_exact: usize,
    wilcoxon: usize,
    wilcoxon_exact: usize,
    permutation: usize,
    skewness: usize,
    interval: usize,
}

impl Compared {
    fn ranks(&mut self, number: usize, values: &RepeatedMeasures, peer: &Value) {
        let Ok(test) = friedman(&values.complete()) else {
            assert!(peer.is_null(), "{number}: {peer}");
            return;
        };
        near(&format!("{number} Friedman"), test.statistic, &peer["statistic"]);
        let w = test.statistic / (test.n * test.degrees_of_freedom) as f64;
        assert!((test.kendalls_w - w).abs() < 1e-12);
        if test.p_method == PValueMethod::Asymptotic {
            near(&format!("{number} Friedman's p"), test.p, &peer["p"]);
            self.friedman += 1;
        } else if !peer["exact"].is_null() {
            near(&format!("{number} Friedman's exact p"), test.p, &peer["exact"]);
            self.friedman_exact += 1;
        }
    }

    fn signed_ranks(&mut self, number: usize, test: Result<Wilcoxon, StatisticsError>, peer: &Value) {
        let Ok(test) = test else {
            assert!(peer.is_null(), "{number}: {peer}");
            return;
        };
        near(&format!("{number} W+"), test.w_plus, &peer["plus"]);
        near(&format!("{number} W-"), test.w_minus, &peer["minus"]);
        if test.p_method == PValueMethod::Asymptotic {
            near(&format!("{number} Wilcoxon's p"), test.p, &peer["approximate"]);
            self.wilcoxon += 1;
        } else if !peer["p"].is_null() {
            near(&format!("{number} Wilcoxon's exact p"), test.p, &peer["p"]);
            self.wilcoxon_exact += 1;
        }
    }

    fn paired(&mut self, number: usize, differences: &[f64], peer: &Value) {
        if !peer["permutation"].is_null() {
            let test = paired_permutation(differences, 1).unwrap();
            near(&format!("{number} permutation"), test.p, &peer["permutation"]);
            self.permutation += 1;
        }
        if !peer["skewness"].is_null() {
            let [skewness, p] = skewness_test(differences).unwrap();
            near(&format!("{number} skewness"), skewness, &peer["skewness"][0]);
            // SciPy counts a skewness of zero as one of another size.
            if skewness != 0.0 {
                near(&format!("{number} p of skewness"), p, &peer["skewness"][1]);
                self.skewness += 1;
            }
        }
        let Some(bca) = peer.get("bca").filter(|bca| !bca.is_null()) else { return };
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let draws: Vec<f64> = serde_json::from_value(bca["draws"].clone()).unwrap();
        let without = |gone: usize| [&differences[..gone], &differences[gone + 1..]].concat();
        let jackknife: Vec<f64> = (0..differences.len()).map(|gone| mean(&without(gone))).collect();
        if let Some(interval) = bca_interval(mean(differences), &draws, &jackknife, 0.95) {
            near(&format!("{number} lower end"), interval.low, &bca["low"]);
            near(&format!("{number} upper end"), interval.high, &bca["high"]);
            self.interval += 1;
        }
    }
}

#[test]
fn two_hundred_data_sets_come_out_as_in_scipy_and_statsmodels() {
    let Some(python) = peers() else { return };
    let sets: Vec<DataSet> = (0..200).map(data_set).collect();
    let answers = ask(&python, &sets);
    assert_eq!(answers.len(), sets.len());
    let mut compared = Compared::default();
    for (number, (set, answer)) in sets.iter().zip(&answers).enumerate() {
        let conditions = (0..set.rows[0].len()).map(|c| c.to_string()).collect();
        let values = RepeatedMeasures::new(conditions, set.rows.clone()).unwrap();
        compared.ranks(number, &values, &answer["friedman"]);
        let differences: Vec<f64> = values.pairs(0, 1).into_iter().map(|[a, b]| b - a).collect();
        compared.signed_ranks(number, wilcoxon(&differences), &answer["paired"]["wilcoxon"]);
        compared.paired(number, &differences, &answer["paired"]);
        for (ours, theirs) in holm(&set.chances).into_iter().zip(answer["holm"].as_array().unwrap()) {
            near(&format!("{number} Holm"), ours, theirs);
        }
    }
    println!("{compared:?}");
    let Compared { friedman, friedman_exact, wilcoxon, wilcoxon_exact, permutation, skewness, interval } =
        compared;
    for count in [friedman, friedman_exact, wilcoxon, wilcoxon_exact, permutation, skewness, interval] {
        assert!(count >= 20, "too little was compared");
    }
}

/// Values of 0.1 steps beside a large offset, whose ties rounding breaks; the peer gets the steps as whole numbers.
#[test]
fn ties_that_rounding_breaks_have_the_chances_of_the_exact_values() {
    let Some(python) = peers() else { return };
    let steps: Vec<DataSet> = (0..200)
        .map(|number| {
            let whole = |value: Option<f64>| value.map(|value| (value * 2.0).round());
            let set = data_set(number);
            let rows = set.rows.into_iter().map(|row| row.into_iter().map(whole).collect()).collect();
            DataSet { rows, chances: set.chances }
        })
        .collect();
    let answers = ask(&python, &steps);
    let (mut compared, mut broken) = (Compared::default(), 0);
    for (number, (set, answer)) in steps.iter().zip(&answers).enumerate() {
        // Of three equal ways to the same value one is drawn by its place.
        let mut index = number;
        let mut inexact = |step: f64| {
            index += 1;
            [12.3 + step * 0.1, 12.0 + (step + 3.0) / 10.0, (123.0 + step) * 0.1][index % 3]
        };
        let rows: Vec<Vec<Option<f64>>> =
            set.rows.iter().map(|row| row.iter().map(|value| value.map(&mut inexact)).collect()).collect();
        let conditions = (0..rows[0].len()).map(|c| c.to_string()).collect();
        let values = RepeatedMeasures::new(conditions, rows).unwrap();
        compared.ranks(number, &values, &answer["friedman"]);
        let pairs = values.pairs(0, 1);
        broken += pairs.iter().filter(|[a, b]| a != b && (a - b).abs() < 1e-9).count();
        compared.signed_ranks(number, wilcoxon_of_pairs(&pairs), &answer["paired"]["wilcoxon"]);
    }
    println!("{compared:?}, {broken} broken ties");
    let Compared { friedman, friedman_exact, wilcoxon, wilcoxon_exact, .. } = compared;
    for count in [friedman, friedman_exact, wilcoxon, wilcoxon_exact, broken] {
        assert!(count >= 20, "too little was compared");
    }
}
