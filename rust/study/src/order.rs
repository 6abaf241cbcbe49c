use crate::{StudyPlan, StudyPlanError, plan::MAX_CONDITIONS};
use rand::{RngExt, SeedableRng, seq::SliceRandom};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// Up to so many conditions all their orders are looked at (5,040); beyond, so many that are drawn.
const MAX_CONDITIONS_ENUMERATED: usize = 7;
const SAMPLED_ORDERS: usize = 3000;
/// Most conditions of `all`: 720 orders.
const MAX_CONDITIONS_OF_ALL: usize = 6;
/// Passes over all participants in which an order is replaced by a better one.
const MAX_PASSES: usize = 20;
/// Draws in which one that keeps the constraints must be found.
const MAX_DRAWS: usize = 200_000;

/// In which order each participant meets the conditions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "by", rename_all = "snake_case", deny_unknown_fields)]
pub enum ConditionOrder {
    /// All participants, as the plan lists them.
    Listed {},
    /// As written down, a row for each participant.
    Table {
        /// Names of conditions.
        rows: Vec<Vec<String>>,
    },
    /// The rows of a cyclic Latin square in turn: among as many participants as there are conditions each condition is once in
    /// each place.
    LatinSquare {},
    /// The rows of a Williams design in turn (E. J. Williams, Australian Journal of Scientific Research A 2, 1949): a Latin
    /// square in which each condition also follows each other one equally often; two squares for an odd number of conditions.
    Williams {},
    /// All orders in turn.
    All {},
    /// Rows that are as balanced as a search finds them, by place first and by succession next, among those that keep the
    /// constraints.
    Balanced {
        /// Groups that take turns: no two conditions of one group follow each other, and each place has the same group in
        /// a participant's order.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        alternate: Vec<Vec<String>>,
        /// Pairs that never follow each other, in either order.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        never_adjacent: Vec<[String; 2]>,
    },
}

/// Constraints on an order, by places of conditions in the plan.
#[derive(Default)]
struct OrderConstraints {
    /// Group of each condition; none without groups.
    groups: Vec<usize>,
    never_adjacent: Vec<[usize; 2]>,
}

impl OrderConstraints {
    /// Whether `next` may come behind `so_far`.
    fn allow(&self, so_far: &[usize], next: usize) -> bool {
        let Some(&before) = so_far.last() else { return true };
        if self.never_adjacent.iter().any(|pair| *pair == [before, next] || *pair == [next, before]) {
            return false;
        }
        if self.groups.is_empty() {
            return true;
        }
        let count = self.groups.iter().max().map_or(1, |max_index| max_index + 1);
        let turn = |k: usize| self.groups[so_far[k]];
        match so_far.len() {
            // The first round says whose turn it is; the others repeat it.
            at if at < count => so_far.iter().all(|&other| self.groups[other] != self.groups[next]),
            at => turn(at - count) == self.groups[next],
        }
    }

    fn allow_all(&self, order: &[usize]) -> bool {
        (0..order.len()).all(|k| self.allow(&order[..k], order[k]))
    }
}

/// A row of a cyclic Latin square.
fn latin_square(count: usize) -> Vec<Vec<usize>> {
    (0..count).map(|row| (0..count).map(|position| (row + position) % count).collect()).collect()
}

/// Rows of a Williams design: 0, 1, n-1, 2, n-2, .. and its shifts; for an odd number also what they are backwards.
fn williams(count: usize) -> Vec<Vec<usize>> {
    let first: Vec<usize> = (0..count)
        .map(|position| match position {
            0 => 0,
            _ if position % 2 == 1 => position / 2 + 1,
            _ => count - position / 2,
        })
        .collect();
    let shifted = |row: usize| -> Vec<usize> { first.iter().map(|k| (k + row) % count).collect() };
    let rows: Vec<Vec<usize>> = (0..count).map(shifted).collect();
    if count.is_multiple_of(2) {
        return rows;
    }
    let backwards = rows.iter().map(|row| row.iter().rev().copied().collect());
    rows.clone().into_iter().chain(backwards).collect()
}

/// All orders of `count` conditions that keep the constraints.
fn all_orders(count: usize, constraints: &OrderConstraints) -> Vec<Vec<usize>> {
    fn grow(
        so_far: &mut Vec<usize>,
        count: usize,
        constraints: &OrderConstraints,
        found: &mut Vec<Vec<usize>>,
    ) {
        if so_far.len() == count {
            found.push(so_far.clone());
            return;
        }
        for next in 0..count {
            if !so_far.contains(&next) && constraints.allow(so_far, next) {
                so_far.push(next);
                grow(so_far, count, constraints, found);
                so_far.pop();
            }
        }
    }
    let mut found = Vec::new();
    grow(&mut Vec::new(), count, constraints, &mut found);
    found
}

/// Orders that keep the constraints, drawn: conditions are taken in a random order, as long as one fits.
fn sample_orders(count: usize, constraints: &OrderConstraints, seed: u64) -> Vec<Vec<usize>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x6f72_6465_7273);
    let mut found = Vec::new();
    for _ in 0..MAX_DRAWS {
        let mut left: Vec<usize> = (0..count).collect();
        left.shuffle(&mut rng);
        let mut order = Vec::with_capacity(count);
        while let Some(k) = left.iter().position(|&next| constraints.allow(&order, next)) {
            order.push(left.remove(k));
        }
        if order.len() == count {
            found.push(order);
        }
        if found.len() == SAMPLED_ORDERS {
            break;
        }
    }
    found
}

/// Groups of equal size that take turns, by Williams designs of each: each condition is once in each place among as many
/// rows as there are conditions. Empty for other groups.
fn interleave_groups(groups: &[usize], shift: usize) -> Vec<Vec<usize>> {
    let count = groups.iter().max().map_or(0, |max_index| max_index + 1);
    let members: Vec<Vec<usize>> =
        (0..count).map(|group| (0..groups.len()).filter(|&k| groups[k] == group).collect()).collect();
    let size = members.first().map_or(0, Vec::len);
    if size == 0 || members.iter().any(|group| group.len() != size) {
        return Vec::new();
    }
    let square = if size.is_multiple_of(2) { williams(size) } else { latin_square(size) };
    let mut rows = Vec::new();
    for row in 0..size {
        for first_condition in 0..count {
            let position = |position: usize| {
                let group = (first_condition + position) % count;
                members[group][square[(row + group * shift) % size][position / count]]
            };
            rows.push((0..groups.len()).map(position).collect());
        }
    }
    rows
}

/// How often each condition is in each place, and follows each other one.
#[derive(Clone)]
struct OrderCounts {
    conditions: usize,
    by_position: Vec<i64>,
    by_predecessor: Vec<i64>,
}

impl OrderCounts {
    fn of(conditions: usize, rows: &[Vec<usize>]) -> Self {
        let empty = vec![0; conditions * conditions];
        let mut counts = Self { conditions, by_position: empty.clone(), by_predecessor: empty };
        for row in rows {
            counts.add(row, 1);
        }
        counts
    }

    fn add(&mut self, row: &[usize], by: i64) {
        for (position, &condition) in row.iter().enumerate() {
            self.by_position[position * self.conditions + condition] += by;
            if position > 0 {
                self.by_predecessor[row[position - 1] * self.conditions + condition] += by;
            }
        }
    }

    /// Sums of squares, by place and by succession; least when the counts are most alike.
    fn cost(&self) -> (i64, i64) {
        let squares = |counts: &[i64]| counts.iter().map(|count| count * count).sum();
        (squares(&self.by_position), squares(&self.by_predecessor))
    }

    /// What the costs would be with `row` as well.
    fn cost_with(&mut self, row: &[usize]) -> (i64, i64) {
        self.add(row, 1);
        let cost = self.cost();
        self.add(row, -1);
        cost
    }
}

/// `count` rows out of `candidates`, each as good as any beside the others.
fn search(
    conditions: usize,
    candidates: &[Vec<usize>],
    count: usize,
    start: Vec<Vec<usize>>,
) -> Vec<Vec<usize>> {
    let mut rows = start;
    let mut counts = OrderCounts::of(conditions, &rows);
    let best = |counts: &mut OrderCounts| -> Option<Vec<usize>> {
        candidates.iter().min_by_key(|row| counts.cost_with(row)).cloned()
    };
    while rows.len() < count {
        let Some(row) = best(&mut counts) else { return rows };
        counts.add(&row, 1);
        rows.push(row);
    }
    for _ in 0..MAX_PASSES {
        let before = counts.cost();
        for row in &mut rows {
            let with = counts.cost();
            counts.add(row, -1);
            if let Some(better) = best(&mut counts).filter(|better| counts.clone().cost_with(better) < with) {
                *row = better;
            }
            counts.add(row, 1);
        }
        if counts.cost() == before {
            break;
        }
    }
    rows
}

/// The rows of a design in turn, `count` of them.
fn cycle_rows(rows: &[Vec<usize>], count: usize) -> Vec<Vec<usize>> {
    (0..count).map(|k| rows[k % rows.len()].clone()).collect()
}

fn balanced_rows(
    conditions: usize,
    participants: usize,
    seed: u64,
    constraints: &OrderConstraints,
) -> Option<Vec<Vec<usize>>> {
    let candidates = if conditions <= MAX_CONDITIONS_ENUMERATED {
        all_orders(conditions, constraints)
    } else {
        sample_orders(conditions, constraints, seed)
    };
    // Designs that are balanced by construction, where there is one, to begin with.
    let designs = [williams(conditions), latin_square(conditions)].into_iter();
    let designs =
        designs.chain((0..conditions.max(1)).map(|shift| interleave_groups(&constraints.groups, shift)));
    let kept = designs.filter(|rows| !rows.is_empty() && rows.iter().all(|row| constraints.allow_all(row)));
    let mut starts: Vec<Vec<Vec<usize>>> = kept.map(|rows| cycle_rows(&rows, participants)).collect();
    if !candidates.is_empty() {
        starts.push(Vec::new());
    }
    let found = starts.into_iter().map(|start| {
        let rows = search(conditions, &candidates, participants, start);
        (OrderCounts::of(conditions, &rows).cost(), rows)
    });
    found.min_by_key(|(cost, _)| *cost).map(|(_, rows)| rows)
}

impl ConditionOrder {
    pub(crate) fn check(&self, plan: &StudyPlan) -> Result<(), StudyPlanError> {
        match self {
            ConditionOrder::Table { rows } => {
                let expected = format!("the {} conditions, each once", plan.conditions.len());
                for (k, row) in rows.iter().enumerate() {
                    let mut positions = Vec::new();
                    for name in row {
                        positions.push(plan.condition_index(&format!("row {} of order", k + 1), name)?);
                    }
                    positions.sort_unstable();
                    if positions != (0..plan.conditions.len()).collect::<Vec<_>>() {
                        let got = row.join(", ");
                        return Err(StudyPlanError::Row { table: "order", row: k + 1, got, expected });
                    }
                }
                if rows.len() != plan.participants {
                    let expected = format!("a row for each of the {} participants", plan.participants);
                    return Err(StudyPlanError::value("the number of rows of order", rows.len(), expected));
                }
                Ok(())
            }
            ConditionOrder::All {} if plan.conditions.len() > MAX_CONDITIONS_OF_ALL => {
                Err(StudyPlanError::value(
                    "order.by",
                    format!("all, of {} conditions", plan.conditions.len()),
                    format!(
                        "at most {MAX_CONDITIONS_OF_ALL} conditions; balanced takes up to {MAX_CONDITIONS}"
                    ),
                ))
            }
            ConditionOrder::Balanced { .. } => self.constraints(plan).map(|_| ()),
            _ => Ok(()),
        }
    }

    fn constraints(&self, plan: &StudyPlan) -> Result<OrderConstraints, StudyPlanError> {
        let ConditionOrder::Balanced { alternate, never_adjacent } = self else {
            return Ok(OrderConstraints::default());
        };
        let mut constraints = OrderConstraints::default();
        if !alternate.is_empty() {
            let mut groups = vec![None; plan.conditions.len()];
            for (group, names) in alternate.iter().enumerate() {
                for name in names {
                    let condition = plan.condition_index("order.alternate", name)?;
                    if groups[condition].replace(group).is_some() {
                        return Err(StudyPlanError::Duplicate {
                            what: "member of order.alternate",
                            name: name.clone(),
                        });
                    }
                }
            }
            let left = groups.iter().position(Option::is_none);
            if let Some(left) = left {
                let got = format!("without {}", plan.conditions[left].name);
                return Err(StudyPlanError::value("order.alternate", got, "each condition in one group"));
            }
            constraints.groups = groups.into_iter().flatten().collect();
        }
        for [a, b] in never_adjacent {
            if a == b {
                return Err(StudyPlanError::value(
                    "order.never_adjacent",
                    format!("{a} and {b}"),
                    "two conditions",
                ));
            }
            constraints.never_adjacent.push([
                plan.condition_index("order.never_adjacent", a)?,
                plan.condition_index("order.never_adjacent", b)?,
            ]);
        }
        Ok(constraints)
    }

    /// For each participant the places of the conditions in the plan.
    pub(crate) fn rows(&self, plan: &StudyPlan) -> Result<Vec<Vec<usize>>, StudyPlanError> {
        let (count, participants) = (plan.conditions.len(), plan.participants);
        Ok(match self {
            ConditionOrder::Listed {} => vec![(0..count).collect(); participants],
            ConditionOrder::Table { rows } => rows
                .iter()
                .map(|row| row.iter().map(|name| plan.condition_index("order", name)).collect())
                .collect::<Result<_, _>>()?,
            ConditionOrder::LatinSquare {} => cycle_rows(&latin_square(count), participants),
            ConditionOrder::Williams {} => cycle_rows(&williams(count), participants),
            ConditionOrder::All {} => {
                cycle_rows(&all_orders(count, &OrderConstraints::default()), participants)
            }
            ConditionOrder::Balanced { alternate, never_adjacent } => {
                let mut rows = balanced_rows(count, participants, plan.seed, &self.constraints(plan)?)
                    .ok_or_else(|| {
                        let groups = alternate.iter().map(|group| format!("alternate {}", group.join("+")));
                        let pairs = never_adjacent.iter().map(|[a, b]| format!("{a} and {b} apart"));
                        StudyPlanError::Impossible {
                            conditions: plan.condition_names(),
                            constraints: groups.chain(pairs).collect::<Vec<_>>().join(", "),
                        }
                    })?;
                // Which participant gets which row is drawn.
                let mut rng = ChaCha8Rng::seed_from_u64(plan.seed);
                for k in (1..rows.len()).rev() {
                    rows.swap(k, rng.random_range(0..=k));
                }
                rows
            }
        })
    }
}
