//! `proact analyze`: tables of whatever was recorded, and the report on them.
//!
//! What is analysed is a study, a folder of trials, a folder of the original lab's bags, or a folder of tables that an export wrote.
//! All of them become the same tables ([`collect_analysis_data`]); the [`report`] is made of these alone.

mod charts;
mod collect;
mod comparisons;
mod figures;
mod flawed_records;
mod html;
mod implausible_cells;
mod leader_board;
mod library;
mod mixed_models;
mod questionnaires;
mod report;
mod scores;
mod summaries;
mod sweeps;
mod traces;
mod training_figures;

pub(crate) use scores::{append, empty_score_tables as tables_of_scores, score_study, trials_and_blocks};
pub(crate) use traces::{Flaw, LiveTraceBuilder};

pub use charts::{ChartError, growth_curve, power_curve};
pub use collect::{AnalysisData, collect_analysis_data};
pub use implausible_cells::ImplausibleCell;
pub use leader_board::{LeaderBoardRow, PairwiseResult, leader_board};
pub use library::ReportLibrary;
pub use report::{ReportOptions, WrittenReport, check_report_folder, report, report_folder};
pub use sweeps::{SweepReport, sweep_report};
pub use training_figures::{TrainingFigure, training_figures};
