//! From a clip to a simulated motion: windows, policies, the rollout, its precision.
//!
//! The policy acts in closed loop, but the command advances in open loop. In every frame the policy
//! sees the reached past and the commanded next second and gives one action. The command advances
//! by a frame whatever was reached. A snapshot holds everything that a frame depends on, so an
//! edited clip is simulated again only from the first frame that can differ.
//!
//! Rejected: policies as functions of the whole clip. A planner that sees all frames would break
//! that rule and could not be compared with the learned policy, which sees only 20 frames ahead. (Inside
//! a gap those frames are of a plan that leads to the next goal, however far that is.)

mod actuation;
mod adaptive_computed_torque;
mod auto;
mod clip_facts;
mod computed_torque;
mod contest;
mod curve;
mod detour;
mod dropout;
mod error;
mod extracted_tasks;
mod fitted;
pub mod floor;
mod gap;
mod gaps;
mod goals;
mod guide;
mod holds;
mod ilc;
mod ilqr;
mod inference;
mod infill;
mod inverse;
mod jam;
mod joint_order;
mod judge;
mod lead;
mod learned;
mod learner;
mod linear;
mod live;
mod model_file;
mod model_frames;
mod natural;
mod nearest;
mod nominal_model;
mod notation;
mod offer;
mod parts;
mod pd;
mod planned;
mod policy;
mod policy_config;
mod policy_name;
mod precision;
mod random;
mod reachable;
mod refine;
mod run;
mod sampling;
mod search;
pub mod shipped;
mod soften;
mod spline;
mod start;
mod stats;
mod suite;
pub mod tasks;
mod ties;
mod trial;
mod window;
mod worst;
mod zero;

pub use auto::{Chosen, Contenders};
pub use clip_facts::{ClipFacts, Settler};
pub use error::Error;
pub use extracted_tasks::{EXTRACTED_FRAMES, Masking, extract_task, extracted_cases, test_suites};
pub use fitted::{FitCard, FitKind, card_of, facts, normaliser};
pub use gaps::{GapFigures, Overshoot};
pub use goals::Goals;
pub use guide::Guide;
pub use ilqr::{Ilqr, IlqrConfig};
pub use inference::Inference;
pub use inverse::{Inverse, InverseSettings};
pub use jam::Off;
pub use joint_order::in_order;
pub use learned::Learned;
pub use learner::Stage;
pub use linear::Linear;
pub use live::{Choice, LiveRollout};
pub use model_file::{load, model_path, robot_card, runs_near};
pub use nearest::{FRAMES as NEAREST_FRAMES, Nearest, NearestSettings};
pub use nominal_model::NominalModel;
pub use offer::{Offer, case, offers};
pub use policy::{Policy, View};
pub use policy_config::PolicyConfig;
pub use policy_name::PolicyName;
pub use precision::{HoldError, Precision, hidden_error};
pub use run::{Frame, Rollout, RolloutConfig};
pub use sampling::{PredictiveSampling, SamplingConfig};
pub use start::Start;
pub use stats::{Interval, mean_ci95};
pub use suite::{
    Case, CaseResult, EvalConfig, Evaluated, Evaluation, Floor, INTERRUPTED, Jam, Suite, evaluate,
    evaluate_on,
};
pub use trial::Trial;
pub use window::{COMMAND, HISTORY, Window};
pub use worst::Worst;
