//! What can go wrong in a study.

use std::error::Error;

/// Why a study could not be designed or carried out. Every message is one line and says what to do.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum StudyError {
    #[error("{0:?} is no factor that can be varied; use one of: {known}", known = super::factorial::names())]
    UnknownFactor(String),
    #[error("{0:?} is varied twice; give its levels in one --vary")]
    FactorTwice(&'static str),
    #[error("{factor} has no level {level:?}; {allowed}")]
    BadLevel { factor: &'static str, level: String, allowed: String },
    #[error("{factor} has the level {level:?} twice; name it once")]
    LevelTwice { factor: &'static str, level: String },
    #[error("the baseline {0:?} is not of the form factor=level,factor=level")]
    BadBaseline(String),
    #[error("the baseline sets {0}, which is not varied; add --vary {0}")]
    BaselineNotVaried(String),
    #[error("{0} combinations are more than {max}; vary fewer settings", max = super::factorial::MAX_COMBINATIONS)]
    TooManyCombinations(usize),
    #[error("{0:?} is not a share such as 3% or 0.03, above 0 and below 1")]
    BadShare(String),
    #[error("{min} rounds are more than --max-rounds {max}")]
    RoundsReversed { min: usize, max: usize },
    #[error("{scene}: {cause}")]
    Scene { scene: String, cause: Box<dyn Error + Send + Sync> },
    #[error(
        "{scene}, {configuration}: {cause}; the other combinations are measured against this one, so choose another --baseline"
    )]
    Baseline { scene: String, configuration: String, cause: String },
}
