use super::*;

/// What scikit-learn 1.9.1 makes of windows of four classes, from `tests/make_classifier_vectors.py`.
#[derive(Deserialize)]
struct Reference {
    train: Vec<Vec<f64>>,
    labels: Vec<usize>,
    #[serde(default)]
    gestures: Vec<Gesture>,
    test: Vec<Vec<f64>>,
    truth: Vec<usize>,
    qda: Answers,
    nb: Answers,
    knn: Answers,
    svm: Answers,
    rf: Range,
}

#[derive(Deserialize)]
struct Answers {
    #[serde(default)]
    decisions: Vec<Vec<f64>>,
    posterior: Vec<Vec<f64>>,
}

/// Share recognised by forests of twenty seeds.
#[derive(Deserialize)]
struct Range {
    least: f64,
    most: f64,
}

impl Reference {
    fn read() -> Reference {
        serde_json::from_str(include_str!("../../tests/classifier_vectors.json"))
            .expect("the vectors are JSON")
    }

    fn fit(&self, kind: ClassifierKind) -> Discriminant {
        let config = EmgConfig { classifier: kind, ..EmgConfig::default() };
        Discriminant::fit(&config, &self.set(&self.matrix())).expect("good data")
    }

    fn matrix(&self) -> DMatrix<f64> {
        let values = self.train.iter().flatten().copied();
        DMatrix::from_row_iterator(self.train.len(), self.train[0].len(), values)
    }

    fn set<'a>(&'a self, samples: &'a DMatrix<f64>) -> TrainingSet<'a> {
        TrainingSet { samples, labels: &self.labels, classes: 4, gestures: &self.gestures }
    }
}

/// Those that tell classes apart.
fn classifiers() -> impl Iterator<Item = ClassifierKind> {
    ClassifierKind::ALL.into_iter().filter(|kind| kind.has_posterior() && !kind.is_process())
}

fn answers(of: &Discriminant, windows: &[Vec<f64>]) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
    let answer = |window: &Vec<f64>| {
        let mut scores = vec![0.0; of.classes()];
        of.scores(window, &mut scores);
        let mut posterior = scores.clone();
        of.posterior(&mut posterior);
        (scores, posterior)
    };
    windows.iter().map(answer).unzip()
}

fn largest(values: &[f64]) -> usize {
    (0..values.len()).fold(0, |best, k| if values[k] > values[best] { k } else { best })
}

fn worst(got: &[Vec<f64>], expected: &[Vec<f64>]) -> f64 {
    assert_eq!(got.len(), expected.len());
    let pairs = got.iter().flatten().zip(expected.iter().flatten());
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn closed_forms_are_those_of_scikit_learn() {
    let reference = Reference::read();
    let (scores, posterior) = answers(&reference.fit(ClassifierKind::Qda), &reference.test);
    assert!(worst(&scores, &reference.qda.decisions) < 1e-9);
    assert!(worst(&posterior, &reference.qda.posterior) < 1e-12);
    let (_, posterior) = answers(&reference.fit(ClassifierKind::Nb), &reference.test);
    assert!(worst(&posterior, &reference.nb.posterior) < 1e-12);
    let (_, posterior) = answers(&reference.fit(ClassifierKind::Knn), &reference.test);
    assert!(worst(&posterior, &reference.knn.posterior) < 1e-12);
}

#[test]
fn support_vectors_are_those_of_scikit_learn_and_their_probabilities_alike() {
    let reference = Reference::read();
    let fitted = reference.fit(ClassifierKind::Svm);
    let Discriminant::Svm(machine) = &fitted else { panic!("asked for a machine") };
    let decisions: Vec<Vec<f64>> = reference.test.iter().map(|w| machine.decisions(w)).collect();
    assert!(worst(&decisions, &reference.svm.decisions) < 1e-3);
    // Platt's sigmoid is fitted on other parts there, by chance.
    let (_, posterior) = answers(&fitted, &reference.test);
    let windows = posterior.iter().zip(&reference.svm.posterior);
    let alike = windows.clone().filter(|(a, b)| largest(a) == largest(b)).count();
    let off: f64 = windows.map(|(a, b)| worst(std::slice::from_ref(a), std::slice::from_ref(b))).sum();
    println!("{alike} of {} classes alike, mean difference {:.3}", posterior.len(), off / 80.0);
    assert!(alike >= 78 && off / 80.0 < 0.05);
}

#[test]
fn a_forest_recognises_what_scikit_learns_do_and_the_same_windows_give_the_same_forest() {
    let reference = Reference::read();
    let forest = reference.fit(ClassifierKind::Rf);
    let (_, posterior) = answers(&forest, &reference.test);
    let right = posterior.iter().zip(&reference.truth).filter(|(p, t)| largest(p) == **t).count();
    let share = right as f64 / reference.test.len() as f64;
    let Range { least, most } = reference.rf;
    println!("{share}, scikit-learn {least} to {most}");
    assert!((least..=most).contains(&share));
    assert_eq!(forest, reference.fit(ClassifierKind::Rf));
}

#[test]
fn every_kind_keeps_its_answers_through_a_file_and_through_another_order_of_features() {
    let reference = Reference::read();
    let turned = |values: &[f64]| {
        let mut values = values.to_vec();
        values.rotate_left(2);
        values
    };
    for kind in classifiers() {
        let fitted = reference.fit(kind);
        assert!(fitted.is_sound() && fitted.kind() == kind);
        let json = serde_json::to_string(&fitted).expect("it can be written");
        assert!(json.starts_with(&format!("{{\"{kind}\"")), "{}", &json[..40]);
        let read: Discriminant = serde_json::from_str(&json).expect("it was just written");
        let (_, expected) = answers(&fitted, &reference.test);
        assert_eq!(answers(&read, &reference.test).1, expected, "{kind}");
        let windows: Vec<Vec<f64>> = reference.test.iter().map(|w| turned(w)).collect();
        let moved = fitted.map_features(&turned).expect("the same numbers");
        assert!(worst(&answers(&moved, &windows).1, &expected) < 1e-9, "{kind}");
        assert_eq!(kind.to_string().parse::<ClassifierKind>(), Ok(kind));
    }
    assert!("ldaa".parse::<ClassifierKind>().is_err_and(|e| e.to_string().contains("qda")));
}

#[test]
fn classes_without_a_covariance_are_refused_by_the_quadratic_one_and_learnt_by_the_others() {
    let reference = Reference::read();
    let mut samples = reference.matrix();
    samples.column_mut(3).fill(1.0);
    let few = TrainingSet {
        samples: &samples,
        labels: &reference.labels,
        classes: 4,
        gestures: &reference.gestures,
    };
    for kind in classifiers() {
        let config = EmgConfig { classifier: kind, ..EmgConfig::default() };
        let fitted = Discriminant::fit(&config, &few);
        match kind {
            ClassifierKind::Qda => {
                let message = fitted.expect_err("a constant feature").to_string();
                assert!(message.contains("feature 3 does not vary"), "{message}");
            }
            _ => assert!(fitted.is_ok_and(|f| f.is_sound()), "{kind}"),
        }
    }
}
