//! The text of which seeds and journals have a hash.

use proact_participants::Population;
use proact_types::renamed_keys::{ConfigFile, RENAMED_KEYS};

/// Keys of the population alone that were renamed since the first fit, and what they were called.
const FIRST_NAMES: [(&str, &str); 6] = [
    ("decision_time_ms", "thinking_ms"),
    ("log_sd", "spread"),
    ("skill_correlation", "skill"),
    ("unlearned_share_per_trial", "unknown_left"),
    ("confusion_retention_per_day", "confusions_left_per_day"),
    ("trunk_share_when_limited", "body_left_when_limited"),
];

/// The population as TOML, with its keys as they were called when the first prediction was made: a name that is another one changes
/// no seed.
///
/// # Errors
/// Never, but for a population that is no TOML.
pub(super) fn hashed_text(population: &Population) -> Result<String, toml::ser::Error> {
    let text = toml::to_string(population)?;
    Ok(text.lines().fold(String::new(), |text, line| text + &with_first_name(line) + "\n"))
}

fn with_first_name(line: &str) -> String {
    if let Some(table) = line.strip_prefix('[') {
        let name = table.trim_end_matches(']');
        return first_name(name).map_or_else(|| line.to_owned(), |first| format!("[{first}]"));
    }
    let first =
        line.split_once(" = ").and_then(|(key, value)| Some(format!("{} = {value}", first_name(key)?)));
    first.unwrap_or_else(|| line.to_owned())
}

fn first_name(key: &str) -> Option<&'static str> {
    let traits = RENAMED_KEYS.iter().filter(|row| row.file == ConfigFile::Trial).filter_map(|row| {
        Some((row.new.strip_prefix("participant.person.")?, row.old.strip_prefix("participant.person.")?))
    });
    FIRST_NAMES.into_iter().chain(traits).find(|(now, _)| *now == key).map(|(_, first)| first)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_text_has_the_names_of_the_first_fit() {
        let text = hashed_text(&Population::standard()).unwrap();
        assert!(
            text.starts_with(
                "[thinking_ms]\nmedian = 422.0\nspread = 1.21\nskill = -0.7\n\n[confusions_per_min]\nmedian = 0.277\n"
            ),
            "{text}"
        );
        assert!(
            text.contains(
                "\n[person]\nthinking_ms = 0\nthinking_spread = 0.5\nconfusions_per_min = 0.0\nconfusion_ms = 700\n\
                 confused_share = 0.8\nposture_confusion = 0.5\nsaccade_ms = 200\nhand_glance_share = 0.3\n"
            ),
            "{text}"
        );
        assert!(
            text.ends_with(
                "lets_go_early = 0.05\n\n[learning]\npractice_exponent = 0.3\nunknown_left = 0.4\nfatigue_per_hour = 0.3\n\
                 drift_per_hour = 0.2\nconfusions_left_per_day = 0.8\nbody_left_when_limited = 0.2\n"
            ),
            "{text}"
        );
    }
}
