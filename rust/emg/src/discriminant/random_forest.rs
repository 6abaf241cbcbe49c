use super::TrainingSet;
use serde::{Deserialize, Serialize};

/// A forest of decision trees (Breiman 2001), as scikit-learn's `RandomForestClassifier`: draws of the windows with
/// repetition, Gini's impurity, the root of the number of features at each node, leaves that are pure; the mean of the
/// trees' shares is the probability. The draws are not scikit-learn's, so the trees are others.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct RandomForest {
    classes: usize,
    features: usize,
    trees: Vec<Vec<Node>>,
}

/// A node of a tree; its children come after it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
enum Node {
    Split { feature: usize, threshold: f64, below: usize, above: usize },
    Leaf { class: usize },
}

/// Trees of a forest (scikit-learn's default).
const TREES: usize = 100;
/// Of the draws.
const SEED: u64 = 2001;

impl RandomForest {
    pub(crate) fn fit(set: &TrainingSet<'_>) -> RandomForest {
        let mut draws = SplitMix64(SEED);
        let windows = set.samples.nrows();
        let trees = (0..TREES).map(|_| {
            let mut bag: Vec<usize> = (0..windows).map(|_| draws.below(windows)).collect();
            let mut nodes = Vec::new();
            grow(set, &mut bag, &mut nodes, &mut draws);
            nodes
        });
        RandomForest { classes: set.classes, features: set.samples.ncols(), trees: trees.collect() }
    }

    pub(crate) fn classes(&self) -> usize {
        self.classes
    }

    pub(crate) fn features(&self) -> usize {
        self.features
    }

    pub(crate) fn is_sound(&self) -> bool {
        let node = |index: usize, node: &Node, length: usize| match *node {
            // Children after their parent: no walk goes round.
            Node::Split { feature, threshold, below, above } => {
                feature < self.features
                    && threshold.is_finite()
                    && [below, above].iter().all(|child| *child > index && *child < length)
            }
            Node::Leaf { class } => class < self.classes,
        };
        let tree = |nodes: &Vec<Node>| {
            !nodes.is_empty() && nodes.iter().enumerate().all(|(k, n)| node(k, n, nodes.len()))
        };
        self.classes >= 2 && self.features > 0 && !self.trees.is_empty() && self.trees.iter().all(tree)
    }

    pub(crate) fn map_features(&self, order: &dyn Fn(&[f64]) -> Vec<f64>) -> RandomForest {
        let index_features: Vec<f64> = (0..self.features).map(|index| index as f64).collect();
        let moved = order(&index_features);
        let new = |old: usize| moved.iter().position(|index| *index as usize == old).unwrap_or(old);
        let map = |node: &Node| match *node {
            Node::Split { feature, threshold, below, above } => {
                Node::Split { feature: new(feature), threshold, below, above }
            }
            leaf => leaf,
        };
        RandomForest {
            trees: self.trees.iter().map(|tree| tree.iter().map(map).collect()).collect(),
            ..self.clone()
        }
    }

    pub(crate) fn scores(&self, features: &[f64], out: &mut [f64]) {
        if !features.iter().all(|v| v.is_finite()) {
            out.fill(f64::NAN);
            return;
        }
        out.fill(0.0);
        for tree in &self.trees {
            let mut index = 0;
            let class = loop {
                match tree[index] {
                    Node::Split { feature, threshold, below, above } => {
                        index = if features[feature] <= threshold { below } else { above };
                    }
                    Node::Leaf { class } => break class,
                }
            };
            out[class] += 1.0 / self.trees.len() as f64;
        }
    }
}

/// Grows the tree of the windows in `bag`; gives the place of its root.
fn grow(set: &TrainingSet<'_>, bag: &mut [usize], nodes: &mut Vec<Node>, draws: &mut SplitMix64) -> usize {
    let index = nodes.len();
    let mut counts = vec![0_usize; set.classes];
    bag.iter().for_each(|window| counts[set.labels[*window]] += 1);
    let majority = (0..set.classes).fold(0, |best, k| if counts[k] > counts[best] { k } else { best });
    nodes.push(Node::Leaf { class: majority });
    if counts[majority] == bag.len() {
        return index;
    }
    let Some((feature, threshold)) = best_split(set, bag, &counts, draws) else { return index };
    bag.sort_by(|a, b| set.samples[(*a, feature)].total_cmp(&set.samples[(*b, feature)]));
    let middle = bag.partition_point(|window| set.samples[(*window, feature)] <= threshold);
    let (low, high) = bag.split_at_mut(middle);
    let below = grow(set, low, nodes, draws);
    let above = grow(set, high, nodes, draws);
    nodes[index] = Node::Split { feature, threshold, below, above };
    index
}

/// The split of the least impurity among features drawn at random; more are drawn while those drawn are constant.
fn best_split(
    set: &TrainingSet<'_>,
    bag: &[usize],
    counts: &[usize],
    draws: &mut SplitMix64,
) -> Option<(usize, f64)> {
    let features = set.samples.ncols();
    let wanted = (features as f64).sqrt().floor().max(1.0) as usize;
    let mut order: Vec<usize> = (0..features).collect();
    let mut column: Vec<(f64, usize)> = Vec::with_capacity(bag.len());
    let (mut tried, mut best) = (0, None::<(f64, usize, f64)>);
    for k in 0..features {
        if tried == wanted {
            break;
        }
        order.swap(k, k + draws.below(features - k));
        let feature = order[k];
        column.clear();
        column.extend(bag.iter().map(|window| (set.samples[(*window, feature)], set.labels[*window])));
        column.sort_by(|a, b| a.0.total_cmp(&b.0));
        if column[0].0 == column[column.len() - 1].0 {
            continue;
        }
        tried += 1;
        let (mut low, mut high) = (vec![0_usize; counts.len()], counts.to_vec());
        for (n, pair) in column.windows(2).enumerate() {
            low[pair[0].1] += 1;
            high[pair[0].1] -= 1;
            let threshold = pair[0].0 + (pair[1].0 - pair[0].0) / 2.0;
            if pair[0].0 == pair[1].0 || threshold >= pair[1].0 {
                continue;
            }
            // The purer both sides, the larger the sum of squares over their sizes.
            let squares = |counts: &[usize]| counts.iter().map(|c| (c * c) as f64).sum::<f64>();
            let purity = squares(&low) / (n + 1) as f64 + squares(&high) / (column.len() - n - 1) as f64;
            if best.is_none_or(|(max_purity, ..)| purity > max_purity) {
                best = Some((purity, feature, threshold));
            }
        }
    }
    best.map(|(_, feature, threshold)| (feature, threshold))
}

/// Draws of a fixed sequence (SplitMix64, Steele et al. 2014).
struct SplitMix64(u64);

impl SplitMix64 {
    /// A number below `bound`, which is above zero.
    fn below(&mut self, bound: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        ((u128::from(z) * bound as u128) >> 64) as usize
    }
}
