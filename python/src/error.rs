//! Errors as exceptions; the message has the place.

use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyKeyboardInterrupt, PyValueError};
use pyo3::prelude::*;
use robert::exit::{Exit, HasExit};

create_exception!(_native, RobertError, PyException, "Something in robert_studio failed.");
create_exception!(
    _native,
    InvalidInput,
    RobertError,
    "A file or value is wrong; the message names the place."
);
create_exception!(_native, MissingDependency, RobertError, "Something must be installed first.");

/// The exception of an error: its whole chain of causes as the message.
pub(crate) fn raise(error: impl HasExit) -> PyErr {
    let mut text = error.to_string();
    let mut cause = std::error::Error::source(&error);
    while let Some(e) = cause {
        let more = e.to_string();
        if !text.contains(&more) {
            text = format!("{text}: {more}");
        }
        cause = e.source();
    }
    match error.exit() {
        Exit::Usage => PyValueError::new_err(text),
        Exit::Invalid => InvalidInput::new_err(text),
        Exit::Missing => MissingDependency::new_err(text),
        Exit::Interrupted => PyKeyboardInterrupt::new_err(text),
        _ => RobertError::new_err(text),
    }
}

/// A value that Python gave and that makes no sense.
pub(crate) fn wrong(text: impl Into<String>) -> PyErr {
    PyValueError::new_err(text.into())
}
