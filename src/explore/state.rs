//! The state that a training run must keep to continue after a kill with the same result.

use robert_linalg::Real;

/// One piece of state, passed to a visitor that either saves or restores it.
#[derive(Debug)]
pub(crate) enum Field<'a, T> {
    /// Network-precision numbers.
    Reals(&'a mut Vec<T>),
    /// Running moments.
    Doubles(&'a mut [f64]),
    /// A counter.
    Count(&'a mut u64),
}

/// State that can be visited. The same visit serves saving and restoring, so that the two always
/// agree.
pub(crate) trait Keep<T: Real> {
    /// Calls `visit` with the name and place of each piece.
    fn keep(&mut self, visit: &mut dyn FnMut(&str, Field<'_, T>));
}

impl<T: Real> super::mlp::Adam<T> {
    /// As [`Keep::keep`], under this name.
    pub(crate) fn keep_as(&mut self, name: &str, visit: &mut dyn FnMut(&str, Field<'_, T>)) {
        visit(&format!("{name}.m"), Field::Reals(&mut self.m));
        visit(&format!("{name}.v"), Field::Reals(&mut self.v));
        visit(&format!("{name}.steps"), Field::Count(&mut self.steps));
    }
}
