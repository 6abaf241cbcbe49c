use proact_types::PlanStatus;

/// How a plan ended, in at most five words, for a display.
pub fn status_label(status: PlanStatus) -> &'static str {
    match status {
        PlanStatus::Ok => "Ready",
        PlanStatus::Intermediate => "Goes part of the way",
        PlanStatus::NoPlan => "No way was found",
        PlanStatus::Unreachable => "Out of reach",
        PlanStatus::StartInCollision => "Arm is stuck on something",
        PlanStatus::GoalInCollision => "Something is in the way",
        PlanStatus::Invalid => "Request makes no sense",
        PlanStatus::Cancelled => "Stopped",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_says_the_same_of_a_plan_that_failed() {
        let page = include_str!("../../bridge/web/src/strings.ts");
        for status in [
            PlanStatus::NoPlan,
            PlanStatus::Unreachable,
            PlanStatus::StartInCollision,
            PlanStatus::GoalInCollision,
        ] {
            assert!(page.contains(&format!("\"{}\"", status_label(status))), "{status:?}");
        }
    }

    #[test]
    fn every_end_of_a_plan_is_told_in_at_most_five_words_of_its_own() {
        let all = [
            PlanStatus::Ok,
            PlanStatus::Intermediate,
            PlanStatus::NoPlan,
            PlanStatus::Unreachable,
            PlanStatus::StartInCollision,
            PlanStatus::GoalInCollision,
            PlanStatus::Invalid,
            PlanStatus::Cancelled,
        ];
        let words = all.map(status_label);
        for (k, text) in words.iter().enumerate() {
            assert!((1..=5).contains(&text.split_whitespace().count()), "{text}");
            assert!(!words[..k].contains(text), "{text}");
        }
    }
}
