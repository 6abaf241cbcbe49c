use serde::{Deserialize, Serialize};
use std::{fmt, str::FromStr};

/// What a person was asked to do with the body.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Instruction {
    /// The upper body may move (paper, Study 1).
    #[default]
    Free,
    /// The upper body moves only where something is out of reach (paper, Study 2).
    LimitBody,
}

impl Instruction {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Free, Self::LimitBody];

    /// As plans and tables have it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Free => "free",
            Self::LimitBody => "limit_body",
        }
    }
}

impl fmt::Display for Instruction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Instruction {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|instruction| instruction.name() == name);
        found.ok_or_else(|| {
            format!("there is no instruction {name:?}, expected {}", Self::ALL.map(Self::name).join(" or "))
        })
    }
}
