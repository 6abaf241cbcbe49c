use crate::ConfigError;
use serde::{Deserialize, Serialize};

/// What a trial takes from elsewhere, such as its arm: the name, and a hash of what went by this name when the trial was
/// made. Written to the record, so that a trial is never computed again with another one unnoticed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PinnedContent {
    /// By which it is found.
    pub name: String,
    /// BLAKE3 of its content, 64 hexadecimal digits; none before the trial is put together.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hash: Option<String>,
}

impl PinnedContent {
    /// A name alone.
    pub fn named(name: &str) -> Self {
        Self { name: name.to_owned(), hash: None }
    }

    /// Takes `given` for what is meant, by name and, where both have one, by hash. `kind` is said in errors: `arm`.
    ///
    /// # Errors
    /// As [`PinnedContent::pin`].
    pub fn check_and_adopt(&mut self, kind: &'static str, given: &PinnedContent) -> Result<(), ConfigError> {
        if self.name != given.name {
            let (expected, got) = (self.name.clone(), given.name.clone());
            return Err(ConfigError::NameMismatch { kind, expected, got });
        }
        match (&self.hash, &given.hash) {
            (Some(expected), Some(got)) if expected != got => Err(ConfigError::ContentMismatch {
                kind,
                name: given.name.clone(),
                expected: short_hash(expected),
                got: short_hash(got),
            }),
            (None, Some(_)) => {
                self.hash.clone_from(&given.hash);
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// Takes `content`, which is called `name`, for what is meant. `kind` is said in errors: `arm`, `task`.
    ///
    /// # Errors
    /// [`ConfigError::NameMismatch`] or [`ConfigError::ContentMismatch`] if another one is meant.
    pub fn pin_content(
        &mut self,
        kind: &'static str,
        name: &str,
        content: &impl Serialize,
    ) -> Result<(), ConfigError> {
        let text =
            serde_json::to_vec(content).map_err(|e| ConfigError::Text(format!("{kind} {name}: {e}")))?;
        let hash = Some(blake3::hash(&text).to_hex().to_string());
        self.check_and_adopt(kind, &PinnedContent { name: name.to_owned(), hash })
    }
}

/// Enough of a hash to tell it by.
fn short_hash(hash: &str) -> String {
    hash.chars().take(12).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_pinned_is_told_from_another_one_by_name_and_by_content() {
        let mut arm = PinnedContent::named("left");
        assert_eq!(
            arm.pin_content("arm", "right", &[1.0]).expect_err("another name").to_string(),
            "arm is \"right\", the trial's is \"left\""
        );
        arm.pin_content("arm", "left", &[1.0]).expect("the first content is the one");
        let pinned = arm.clone();
        arm.pin_content("arm", "left", &[1.0]).expect("the same again");
        let error = arm.pin_content("arm", "left", &[1.5]).expect_err("another content").to_string();
        assert!(error.starts_with("arm \"left\" is another one here (hash "), "{error}");
        assert_eq!(arm, pinned);
    }
}
