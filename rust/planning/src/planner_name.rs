use crate::PlanningError;
use std::{fmt, str::FromStr};

/// A planner of OMPL, by its name there. All are repeatable by the request's seed and bounded by iterations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum PlannerName {
    /// Two trees that grow towards each other (Kuffner and LaValle, ICRA 2000). The quickest here.
    #[default]
    RrtConnect,
    /// Two trees that avoid costly ground (Devaurs, Siméon and Cortés, 2013).
    BiTrrt,
    /// Two lazy trees spread over a grid (Şucan and Kavraki, WAFR 2008): the planner of the original.
    LbKpiece1,
    /// One tree that goes on improving until its iterations are spent (Karaman and Frazzoli, 2011): short paths,
    /// a hundred times the time of RRTConnect.
    RrtStar,
    /// A roadmap (Kavraki et al., 1996): made anew for each request, or begun with a stored [`Roadmap`](crate::Roadmap),
    /// of which no more is looked at than a way needs (Bohlin and Kavraki, ICRA 2000).
    Prm,
    /// RRTConnect again and again until the iterations or the time are spent, and the best parts of all paths put
    /// together (Raveh, Enosh and Halperin, 2011; Luna et al., ICRA 2013).
    AnytimePathShortening,
}

impl PlannerName {
    /// All planners, the default first.
    pub const ALL: [PlannerName; 6] = [
        Self::RrtConnect,
        Self::BiTrrt,
        Self::LbKpiece1,
        Self::RrtStar,
        Self::Prm,
        Self::AnytimePathShortening,
    ];

    /// The name in OMPL.
    pub fn name(self) -> &'static str {
        match self {
            Self::RrtConnect => "RRTConnect",
            Self::BiTrrt => "BiTRRT",
            Self::LbKpiece1 => "LBKPIECE1",
            Self::RrtStar => "RRTstar",
            Self::Prm => "PRM",
            Self::AnytimePathShortening => "AnytimePathShortening",
        }
    }
}

impl fmt::Display for PlannerName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for PlannerName {
    type Err = PlanningError;

    fn from_str(text: &str) -> Result<Self, PlanningError> {
        Self::ALL.into_iter().find(|planner| planner.name() == text).ok_or_else(|| {
            let known = Self::ALL.map(Self::name).join(", ");
            PlanningError::UnknownPlanner { got: text.to_owned(), known }
        })
    }
}
