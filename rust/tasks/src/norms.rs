use serde::{Deserialize, Serialize};
use std::fmt;

const BBT_NORMS: &str = include_str!("../data/bbt_norms.toml");

/// Sex, as tables of norms have it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sex {
    /// Women.
    Female,
    /// Men.
    Male,
}

/// Who wears the arm, as far as norms and sizes go by it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UserProfile {
    /// Age, years.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub age_years: Option<u32>,
    /// Sex.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sex: Option<Sex>,
}

/// What people with two sound hands reach in a task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NormativeScore {
    /// Whose numbers.
    pub source: String,
    /// They were seen in the source; others are recalled.
    pub confirmed: bool,
    /// Of whom; of both where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sex: Option<Sex>,
    /// `right` or `left`; the dominant one where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hand: Option<String>,
    /// From and to, years, both included; of all where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ages: Option<[u32; 2]>,
    /// Mean score.
    pub mean: f64,
    /// Standard deviation between people.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sd: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct NormFile {
    norm: Vec<NormativeScore>,
}

/// The norms of the task called `task` that are of people like `user_profile`, with the arm on the `left` or the right; none where
/// there are none. What is not known of the wearer excludes norms that go by it, except by sex, where both are given.
pub fn norms(task: &str, user_profile: &UserProfile, left: bool) -> Vec<NormativeScore> {
    if task != "bbt" {
        return Vec::new();
    }
    let file: NormFile = toml::from_str(BBT_NORMS).expect("ships with the program and is tested");
    let hand = if left { "left" } else { "right" };
    let fits = |norm: &NormativeScore| {
        let sex = norm.sex.is_none_or(|sex| user_profile.sex.is_none_or(|own| own == sex));
        let age = norm
            .ages
            .is_none_or(|[from, to]| user_profile.age_years.is_some_and(|age| (from..=to).contains(&age)));
        sex && age && norm.hand.as_deref().is_none_or(|of| of == hand)
    };
    file.norm.into_iter().filter(fits).collect()
}

impl fmt::Display for NormativeScore {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "norm {:.1}", self.mean)?;
        if let Some(sd) = self.sd {
            write!(f, " (SD {sd:.1})")?;
        }
        match self.sex {
            Some(Sex::Female) => write!(f, ", women")?,
            Some(Sex::Male) => write!(f, ", men")?,
            None => {}
        }
        match self.ages {
            Some([0, to]) => write!(f, ", up to {to} years")?,
            Some([from, to]) if to >= 100 => write!(f, ", {from} years and older")?,
            Some([from, to]) => write!(f, ", {from} to {to} years")?,
            None => {}
        }
        if let Some(hand) = &self.hand {
            write!(f, ", {hand} hand")?;
        }
        write!(f, ": {}{}", self.source, if self.confirmed { "" } else { " (unconfirmed: recalled)" })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn warnings(user_profile: UserProfile) -> Vec<String> {
        norms("bbt", &user_profile, false).iter().map(NormativeScore::to_string).collect()
    }

    #[test]
    fn norms_are_those_of_people_like_the_wearer_and_say_when_they_are_recalled() {
        let woman = UserProfile { age_years: Some(23), sex: Some(Sex::Female) };
        assert_eq!(
            warnings(woman),
            [
                "norm 81.3 (SD 15.4), women: Benin, 692 people, dominant hand",
                "norm 89.1, up to 24 years: Benin, 692 people, dominant hand",
                "norm 88.0 (SD 8.3), women, 20 to 24 years, right hand: Mathiowetz et al. 1985 (unconfirmed: recalled)",
            ]
        );
        assert_eq!(
            warnings(UserProfile::default()).len(),
            2,
            "of nobody in particular: those of women and of men"
        );
        assert!(norms("targeted_bbt", &woman, false).is_empty());
        let left = norms("bbt", &woman, true);
        assert_eq!(left.last().map(|norm| norm.mean), Some(83.4));
    }

    #[test]
    fn every_age_from_twenty_on_has_one_recalled_norm_for_each_sex_and_hand() {
        for age_years in (20..120).map(Some) {
            for (sex, left) in
                [(Sex::Female, false), (Sex::Female, true), (Sex::Male, false), (Sex::Male, true)]
            {
                let of = norms("bbt", &UserProfile { age_years, sex: Some(sex) }, left);
                assert_eq!(
                    of.iter().filter(|norm| !norm.confirmed).count(),
                    1,
                    "{age_years:?} {sex:?} {left}"
                );
            }
        }
    }
}
