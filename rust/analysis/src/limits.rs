//! The largest values that an arm or a person can produce. A larger one in a table is an error of the table.

use crate::table::{Cell, Table};

/// Fastest hand, m/s: unhindered reaches of adults stay below 4 m/s, and the arm adds its joints' speeds (below 1 m/s) to a shoulder
/// that is followed at 2 m/s at most.
pub const HAND_M_PER_S: f64 = 6.0;
/// Strongest acceleration of the hand, m/s²: six times gravity, some twice that of the fastest reaches. A place that is 12 cm off
/// for one instant exceeds it after the low-pass at 6 Hz.
pub const HAND_M_PER_S2: f64 = 60.0;
/// Fastest shoulder, m/s: a tracked one is followed at 2 m/s by default, and a person who walks to the table has 1.5 m/s.
pub const SHOULDER_M_PER_S: f64 = 3.0;
/// Furthest that shoulder or trunk go in a trial at a table, mm: from the hip to the shoulder it is 0.45 to 0.6 m, and a trunk that
/// is bent by 60 degrees and turned by 60 brings the shoulder less than 0.9 m away.
pub const BODY_MM: f64 = 1000.0;
/// Furthest that shoulder or trunk turn, degrees: beyond it the box is behind the person.
pub const BODY_TURN_DEG: f64 = 150.0;
/// Fastest joint, as a share of the speed limit in the arm's description. Controllers keep the limit, but a contact pushes a joint past it:
/// a hand that a shoulder at 2 m/s drags along an obstacle 0.1 m from the wrist's axis turns the wrist at 20 rad/s, 40 times the
/// limit of 0.5 rad/s. A joint that jumps by 0.4 rad from one instant to the next, 20 ms later, is as fast.
pub const JOINT_SPEED_SHARE: f64 = 40.0;
/// Furthest that a joint is outside its limits, rad: the stops of the physics give way by less.
pub const JOINT_BEYOND_RAD: f64 = 0.1;
/// Rows of a shorter time have no mean speed, s: the steps of the paper's sums take 0.1 s each.
const SHORTEST_S: f64 = 0.5;

/// The largest possible value of a column.
struct Limit {
    tables: &'static [&'static str],
    column: &'static str,
    /// The column that the value is divided by; empty if by none.
    per: &'static str,
    limit: f64,
    unit: &'static str,
}

const fn of_body(column: &'static str, limit: f64, unit: &'static str) -> Limit {
    Limit { tables: &["phases", "measures", "compensation"], column, per: "", limit, unit }
}

const fn of_phase(column: &'static str, per: &'static str, limit: f64, unit: &'static str) -> Limit {
    Limit { tables: &["phases"], column, per, limit, unit }
}

const LIMITS: &[Limit] = &[
    of_phase("peak_speed_m_per_s", "", HAND_M_PER_S, "m/s"),
    of_phase("hand_path_m", "seconds", HAND_M_PER_S, "m/s"),
    of_phase("peak_acceleration_m_per_s2", "", HAND_M_PER_S2, "m/s²"),
    of_phase("shoulder_peak_speed_m_per_s", "", SHOULDER_M_PER_S, "m/s"),
    of_phase("shoulder_path_m", "seconds", SHOULDER_M_PER_S, "m/s"),
    of_phase("shoulder_sum10_m", "seconds", SHOULDER_M_PER_S, "m/s"),
    of_phase("joint_speed_share", "", JOINT_SPEED_SHARE, "of its limit"),
    of_phase("joint_beyond_rad", "", JOINT_BEYOND_RAD, "rad"),
    of_body("shoulder_range_mm", BODY_MM, "mm"),
    of_body("trunk_range_mm", BODY_MM, "mm"),
    of_body("shoulder_turn_deg", BODY_TURN_DEG, "degrees"),
    of_body("trunk_turn_deg", BODY_TURN_DEG, "degrees"),
];

/// A value in a table beyond its limit.
#[derive(Clone, Debug, PartialEq)]
pub struct Impossible {
    /// Its row.
    pub row: usize,
    /// Its column, with the column that it is divided by behind `/`.
    pub quantity: String,
    /// The value.
    pub value: f64,
    /// Of value and limit.
    pub unit: &'static str,
    /// The largest possible value.
    pub limit: f64,
}

/// The values of `table` that no arm and no person can produce.
pub fn impossible(table: &Table) -> Vec<Impossible> {
    let own = LIMITS.iter().filter(|limit| limit.tables.contains(&table.name));
    let of = |limit: &'static Limit| {
        let rows = table.rows.iter().enumerate();
        rows.filter_map(move |(place, row)| {
            let value = value(table, row, limit)?;
            let per = if limit.per.is_empty() { String::new() } else { format!("/{}", limit.per) };
            (value > limit.limit).then(|| Impossible {
                row: place,
                quantity: format!("{}{per}", limit.column),
                value,
                unit: limit.unit,
                limit: limit.limit,
            })
        })
    };
    let mut found: Vec<Impossible> = own.flat_map(of).collect();
    found.sort_by_key(|impossible| impossible.row);
    found
}

fn value(table: &Table, row: &[Cell], limit: &Limit) -> Option<f64> {
    let value = table.number(row, limit.column)?;
    if limit.per.is_empty() {
        return Some(value);
    }
    table.number(row, limit.per).filter(|per| *per >= SHORTEST_S).map(|per| value / per)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::Column;

    #[test]
    fn a_value_beyond_its_limit_is_found_with_row_value_and_limit_and_a_possible_one_is_not() {
        const fn column(name: &'static str) -> Column {
            Column { name, unit: "", meaning: "", source: "" }
        }
        const COLUMNS: &[Column] =
            &[column("seconds"), column("peak_speed_m_per_s"), column("shoulder_sum10_m")];
        let mut phases = Table::new("phases", "a phase", COLUMNS);
        phases.push(vec![8.0.into(), 0.6.into(), 0.3.into()]);
        phases.push(vec![8.0.into(), 30.5.into(), 1.9.into()]);
        phases.push(vec![2.0.into(), Cell::Missing, 9.0.into()]);
        phases.push(vec![0.02.into(), 0.1.into(), 0.1.into()]);
        let found: Vec<_> =
            impossible(&phases).into_iter().map(|i| (i.row, i.quantity, i.value, i.limit)).collect();
        assert_eq!(
            found,
            [
                (1, "peak_speed_m_per_s".to_owned(), 30.5, HAND_M_PER_S),
                (2, "shoulder_sum10_m/seconds".to_owned(), 4.5, SHOULDER_M_PER_S),
            ]
        );
        assert!(impossible(&Table { name: "trials", ..phases }).is_empty());
    }
}
