//! Hand poses and gestures.
use super::author::Authored;
use crate::robot::{Error, Robot};
pub(super) fn tasks(_robot: &Robot) -> Result<Vec<Authored>, Error> {
    Ok(Vec::new())
}
