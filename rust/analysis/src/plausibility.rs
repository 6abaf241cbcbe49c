//! The largest values that an arm or a person can produce. A larger one in a table is an error of the table.

use crate::table::{Table, TableCell};

/// Fastest hand, m/s: unhindered reaches of adults stay below 4 m/s, and the arm adds its joints' speeds (below 1 m/s) to a shoulder
/// that is followed at 2 m/s at most.
pub const MAX_HAND_SPEED_M_PER_S: f64 = 6.0;
/// Strongest acceleration of the hand, m/s²: six times gravity, some twice that of the fastest reaches. A place that is 12 cm off
/// for one instant exceeds it after the low-pass at 6 Hz.
pub const MAX_HAND_ACCELERATION_M_PER_S2: f64 = 60.0;
/// Fastest shoulder, m/s: a tracked one is followed at 2 m/s by default, and a person who walks to the table has 1.5 m/s.
pub const MAX_SHOULDER_SPEED_M_PER_S: f64 = 3.0;
/// Furthest that shoulder or trunk go in a trial at a table, mm: from the hip to the shoulder it is 0.45 to 0.6 m, and a trunk that
/// is bent by 60 degrees and turned by 60 brings the shoulder less than 0.9 m away.
pub const MAX_BODY_DISPLACEMENT_MM: f64 = 1000.0;
/// Furthest that shoulder or trunk turn, degrees: beyond it the box is behind the person.
pub const MAX_BODY_TURN_DEG: f64 = 150.0;
/// Fastest joint, as a share of the speed limit in the arm's description. Controllers keep the limit, but a contact pushes a joint past it:
/// a hand that a shoulder at 2 m/s drags along an obstacle 0.1 m from the wrist's axis turns the wrist at 20 rad/s, 40 times the
/// limit of 0.5 rad/s. A joint that jumps by 0.4 rad from one instant to the next, 20 ms later, is as fast.
pub const MAX_JOINT_SPEED_RATIO: f64 = 40.0;
/// Furthest that a joint is outside its limits, rad: the stops of the physics give way by less.
pub const MAX_JOINT_LIMIT_EXCESS_RAD: f64 = 0.1;
/// Rows of a shorter time have no mean speed, s: the steps of the paper's sums take 0.1 s each.
const MIN_MEAN_SPEED_SECS: f64 = 0.5;

/// The largest possible value of a column.
struct PlausibilityLimit {
    tables: &'static [&'static str],
    column: &'static str,
    /// The column that the value is divided by; empty if by none.
    divisor_column: &'static str,
    limit: f64,
    unit: &'static str,
}

const fn of_body(column: &'static str, limit: f64, unit: &'static str) -> PlausibilityLimit {
    PlausibilityLimit {
        tables: &["phases", "measures", "compensation"],
        column,
        divisor_column: "",
        limit,
        unit,
    }
}

const fn of_phase(
    column: &'static str,
    per: &'static str,
    limit: f64,
    unit: &'static str,
) -> PlausibilityLimit {
    PlausibilityLimit { tables: &["phases"], column, divisor_column: per, limit, unit }
}

const LIMITS: &[PlausibilityLimit] = &[
    of_phase("peak_speed_m_per_s", "", MAX_HAND_SPEED_M_PER_S, "m/s"),
    of_phase("hand_path_m", "seconds", MAX_HAND_SPEED_M_PER_S, "m/s"),
    of_phase("peak_acceleration_m_per_s2", "", MAX_HAND_ACCELERATION_M_PER_S2, "m/s²"),
    of_phase("shoulder_peak_speed_m_per_s", "", MAX_SHOULDER_SPEED_M_PER_S, "m/s"),
    of_phase("shoulder_path_m", "seconds", MAX_SHOULDER_SPEED_M_PER_S, "m/s"),
    of_phase("shoulder_sum10_m", "seconds", MAX_SHOULDER_SPEED_M_PER_S, "m/s"),
    of_phase("joint_speed_share", "", MAX_JOINT_SPEED_RATIO, "of its limit"),
    of_phase("joint_beyond_rad", "", MAX_JOINT_LIMIT_EXCESS_RAD, "rad"),
    of_body("shoulder_displacement_mm", MAX_BODY_DISPLACEMENT_MM, "mm"),
    of_body("trunk_displacement_mm", MAX_BODY_DISPLACEMENT_MM, "mm"),
    of_body("shoulder_turn_deg", MAX_BODY_TURN_DEG, "degrees"),
    of_body("trunk_turn_deg", MAX_BODY_TURN_DEG, "degrees"),
];

/// A value in a table beyond its limit.
#[derive(Clone, Debug, PartialEq)]
pub struct ImplausibleValue {
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
pub fn find_implausible_values(table: &Table) -> Vec<ImplausibleValue> {
    let own = LIMITS.iter().filter(|limit| limit.tables.contains(&table.name));
    let of = |limit: &'static PlausibilityLimit| {
        let rows = table.rows.iter().enumerate();
        rows.filter_map(move |(index, row)| {
            let value = value(table, row, limit)?;
            let per = if limit.divisor_column.is_empty() {
                String::new()
            } else {
                format!("/{}", limit.divisor_column)
            };
            (value > limit.limit).then(|| ImplausibleValue {
                row: index,
                quantity: format!("{}{per}", limit.column),
                value,
                unit: limit.unit,
                limit: limit.limit,
            })
        })
    };
    let mut found: Vec<ImplausibleValue> = own.flat_map(of).collect();
    found.sort_by_key(|impossible| impossible.row);
    found
}

fn value(table: &Table, row: &[TableCell], limit: &PlausibilityLimit) -> Option<f64> {
    let value = table.number(row, limit.column)?;
    if limit.divisor_column.is_empty() {
        return Some(value);
    }
    table.number(row, limit.divisor_column).filter(|per| *per >= MIN_MEAN_SPEED_SECS).map(|per| value / per)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::TableColumn;

    #[test]
    fn a_value_beyond_its_limit_is_found_with_row_value_and_limit_and_a_possible_one_is_not() {
        const fn column(name: &'static str) -> TableColumn {
            TableColumn { name, unit: "", meaning: "", source: "", formerly: "" }
        }
        const COLUMNS: &[TableColumn] =
            &[column("seconds"), column("peak_speed_m_per_s"), column("shoulder_sum10_m")];
        let mut phases = Table::new("phases", "a phase", COLUMNS);
        phases.push(vec![8.0.into(), 0.6.into(), 0.3.into()]);
        phases.push(vec![8.0.into(), 30.5.into(), 1.9.into()]);
        phases.push(vec![2.0.into(), TableCell::Missing, 9.0.into()]);
        phases.push(vec![0.02.into(), 0.1.into(), 0.1.into()]);
        let found: Vec<_> = find_implausible_values(&phases)
            .into_iter()
            .map(|i| (i.row, i.quantity, i.value, i.limit))
            .collect();
        assert_eq!(
            found,
            [
                (1, "peak_speed_m_per_s".to_owned(), 30.5, MAX_HAND_SPEED_M_PER_S),
                (2, "shoulder_sum10_m/seconds".to_owned(), 4.5, MAX_SHOULDER_SPEED_M_PER_S),
            ]
        );
        assert!(find_implausible_values(&Table { name: "trials", ..phases }).is_empty());
    }
}
