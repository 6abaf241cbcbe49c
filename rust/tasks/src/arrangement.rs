use serde::{Deserialize, Serialize};
use std::{fmt, str::FromStr};

/// The four places on each side of the box: near or far from the person, medial or lateral.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Region {
    /// Far, lateral.
    FL,
    /// Far, medial.
    FM,
    /// Near, lateral.
    NL,
    /// Near, medial.
    NM,
}

impl Region {
    /// All four.
    pub const ALL: [Region; 4] = [Region::FL, Region::FM, Region::NL, Region::NM];
}

/// Where the four blocks stand at the start: red 1, red 2, blue 1, blue 2.
///
/// There are 4! = 24. (The original's generator made 12 of them: `original_proact.md` 5.7.)
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "[Region; 4]", into = "[Region; 4]")]
pub struct Arrangement([Region; 4]);

/// Why an arrangement is refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ArrangementError {
    /// Two blocks in one place.
    #[error("two blocks stand in region {region:?} of {got}; each of FL, FM, NL, NM holds one block")]
    Occupied {
        /// The place.
        region: Region,
        /// The whole arrangement.
        got: String,
    },
    /// The number is out of range.
    #[error("arrangement {got} does not exist; expected 1 to 24")]
    Number {
        /// What was asked for.
        got: usize,
    },
    /// The text is not an arrangement.
    #[error("arrangement {got:?} is unreadable; expected red1,red2,blue1,blue2 such as FL,NM,NL,FM")]
    Text {
        /// The text.
        got: String,
    },
}

impl Arrangement {
    /// All 24, in the lexicographic order of [`Region::ALL`].
    pub fn all() -> impl Iterator<Item = Arrangement> {
        let regions = Region::ALL;
        (0..256usize)
            .map(move |code| [code / 64, code / 16 % 4, code / 4 % 4, code % 4].map(|k| regions[k]))
            .filter_map(|permutation| Arrangement::try_from(permutation).ok())
    }

    /// Arrangement `number`, from 1.
    ///
    /// # Errors
    /// [`ArrangementError::Number`] outside 1 to 24.
    pub fn numbered(number: usize) -> Result<Self, ArrangementError> {
        number.checked_sub(1).and_then(|k| Self::all().nth(k)).ok_or(ArrangementError::Number { got: number })
    }

    /// One that follows from a trial's seed.
    pub fn by_seed(seed: u64) -> Self {
        // SplitMix64's finaliser spreads neighbouring seeds over the 24 arrangements.
        let mut z = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        let number = ((z ^ (z >> 31)) % 24) as usize + 1;
        Self::numbered(number).expect("a number from 1 to 24")
    }

    /// Place of each block: red 1, red 2, blue 1, blue 2.
    pub fn regions(self) -> [Region; 4] {
        self.0
    }
}

impl TryFrom<[Region; 4]> for Arrangement {
    type Error = ArrangementError;

    fn try_from(regions: [Region; 4]) -> Result<Self, ArrangementError> {
        match (0..4).find(|&k| regions[..k].contains(&regions[k])) {
            Some(k) => {
                Err(ArrangementError::Occupied { region: regions[k], got: Arrangement(regions).to_string() })
            }
            None => Ok(Arrangement(regions)),
        }
    }
}

impl From<Arrangement> for [Region; 4] {
    fn from(arrangement: Arrangement) -> Self {
        arrangement.0
    }
}

impl fmt::Display for Arrangement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [a, b, c, d] = self.0;
        write!(f, "{a:?},{b:?},{c:?},{d:?}")
    }
}

impl FromStr for Arrangement {
    type Err = ArrangementError;

    fn from_str(text: &str) -> Result<Self, ArrangementError> {
        let unreadable = || ArrangementError::Text { got: text.to_owned() };
        let region = |name: &str| Region::ALL.into_iter().find(|r| format!("{r:?}") == name.trim());
        let regions: Vec<Region> =
            text.split(',').map(region).collect::<Option<_>>().ok_or_else(unreadable)?;
        Arrangement::try_from(<[Region; 4]>::try_from(regions).map_err(|_| unreadable())?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn the_24_arrangements_differ_and_each_fills_every_region() {
        let all: HashSet<Arrangement> = Arrangement::all().collect();
        assert_eq!(all.len(), 24);
        for arrangement in all {
            let regions: HashSet<Region> = arrangement.regions().into_iter().collect();
            assert_eq!(regions.len(), 4, "{arrangement}");
        }
    }

    #[test]
    fn seeds_spread_over_the_arrangements() {
        let used: HashSet<Arrangement> = (0..200).map(Arrangement::by_seed).collect();
        assert_eq!(used.len(), 24);
    }

    #[test]
    fn an_arrangement_survives_its_text_and_numbers_run_from_1_to_24() {
        for (k, arrangement) in Arrangement::all().enumerate() {
            assert_eq!(arrangement.to_string().parse(), Ok(arrangement));
            assert_eq!(Arrangement::numbered(k + 1), Ok(arrangement));
        }
        assert!(Arrangement::numbered(0).is_err() && Arrangement::numbered(25).is_err());
    }

    #[test]
    fn two_blocks_in_one_place_and_foreign_words_are_refused_by_name() {
        let error = "FL,FL,NM,NL".parse::<Arrangement>().expect_err("two in FL");
        assert!(error.to_string().contains("region FL"), "{error}");
        assert!("FL,NM".parse::<Arrangement>().is_err() && "FL,NM,NL,XX".parse::<Arrangement>().is_err());
    }
}
