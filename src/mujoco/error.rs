//! Errors of the simulator.

use std::path::PathBuf;

use robert_base::exit::{Exit, HasExit};

/// A simulator error.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The XML is malformed or breaks the schema.
    #[error("{place}: {message}", place = place(path.as_ref(), *line))]
    Parse {
        /// The parser's message.
        message: String,
        /// Line in the file, if known (the library has no columns).
        line: Option<u32>,
        /// The file, if there is one.
        path: Option<PathBuf>,
    },
    /// The XML is well formed but does not describe a valid model.
    #[error("{place}: {message}", place = place(path.as_ref(), *line))]
    Compile {
        /// The compiler's message.
        message: String,
        /// Line in the file, if known.
        line: Option<u32>,
        /// The file, if there is one.
        path: Option<PathBuf>,
    },
    /// `mju_error` was raised; the data is poisoned until it is reset.
    #[error("the physics engine failed: {message}")]
    Engine {
        /// The engine's message.
        message: String,
    },
    /// The data was poisoned by an earlier engine error.
    #[error("this simulation stopped after an engine error; reset it first")]
    Poisoned,
    /// The library could not allocate.
    #[error("out of memory while {doing}")]
    Memory {
        /// The call.
        doing: &'static str,
    },
    /// A C++ exception other than the two above.
    #[error("unexpected exception in the physics library: {message}")]
    Cxx {
        /// Its message.
        message: String,
    },
    /// The engine met NaN or a diverging state and silently reset it.
    #[error("the simulation diverged at {time_secs:.3} s: the engine reset the state ({what})")]
    Diverged {
        /// Simulated time before the step, seconds.
        time_secs: f64,
        /// The check that failed: bad qpos, qvel or qacc.
        what: &'static str,
    },
    /// A given value is not finite.
    #[error("{what}[{index}] is {value}, not a finite number")]
    NotFinite {
        /// The name of the vector.
        what: &'static str,
        /// The index of the element.
        index: usize,
        /// The value.
        value: f64,
    },
    /// A vector has the wrong length.
    #[error("{what} has {got} values, but the model needs {want}")]
    Length {
        /// The name of the vector.
        what: &'static str,
        /// Its length.
        got: usize,
        /// The length of the model.
        want: usize,
    },
    /// The model compiles but cannot be simulated.
    #[error("{place}: {message}", place = place(path.as_ref(), None))]
    Invalid {
        /// The problem, in words.
        message: String,
        /// The file, if there is one.
        path: Option<PathBuf>,
    },
    /// The installed library does not have the version that this program was built for.
    #[error(
        "libmujoco {want} is needed, {got} is installed; fix: sudo apt-get install libmujoco2.2.2"
    )]
    Version {
        /// The installed version.
        got: i32,
        /// The required version.
        want: i32,
    },
}

impl HasExit for Error {
    fn exit(&self) -> Exit {
        match self {
            Error::Parse { .. }
            | Error::Compile { .. }
            | Error::Invalid { .. }
            | Error::NotFinite { .. }
            | Error::Length { .. } => Exit::Invalid,
            Error::Version { .. } => Exit::Missing,
            _ => Exit::Failed,
        }
    }
}

impl Error {
    /// The same error with the name of the file.
    #[must_use]
    pub fn at(self, file: &std::path::Path) -> Self {
        let path = Some(file.to_owned());
        match self {
            Error::Parse { message, line, .. } => Error::Parse { message, line, path },
            Error::Compile { message, line, .. } => Error::Compile { message, line, path },
            Error::Invalid { message, .. } => Error::Invalid { message, path },
            other => other,
        }
    }
}

/// `path:line:col`; the library has no columns, so a known line gets column 1.
fn place(path: Option<&PathBuf>, line: Option<u32>) -> String {
    let file = path.map_or_else(|| "model".to_owned(), |p| p.display().to_string());
    match line {
        Some(line) => format!("{file}:{line}:1"),
        None => file,
    }
}

/// Classifies an error of `mj_loadXML` by its three message formats and finds the line.
pub(super) fn refusal(text: &str) -> Error {
    // "… Line number=N" is the XML parser, "… Element 'x', line N" the schema,
    // "… line = N, column = -1" the compiler.
    let syntax = number_after(text, "Line number=").or_else(|| number_after(text, "line number="));
    let schema = text.contains("Schema violation") || text.contains("Element '");
    let line =
        syntax.or_else(|| number_after(text, "line = ")).or_else(|| number_after(text, "line "));
    let message = clean(text);
    let parse = syntax.is_some()
        || schema
        || text.contains("XML parse error")
        || text.contains("Unrecognized")
        || text.contains("XML_ERROR");
    if parse {
        Error::Parse { message, line, path: None }
    } else {
        Error::Compile { message, line, path: None }
    }
}

fn number_after(text: &str, key: &str) -> Option<u32> {
    let at = text.find(key)? + key.len();
    let digits: String = text.get(at..)?.chars().take_while(char::is_ascii_digit).collect();
    digits.parse().ok()
}

/// One line, without the library's own "Error:" prefix.
fn clean(text: &str) -> String {
    let one =
        text.split('\n').map(str::trim).filter(|l| !l.is_empty()).collect::<Vec<_>>().join("; ");
    one.trim_start_matches("Error: ").to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_message_formats_give_a_line() {
        let syntax = refusal("XML parse error 5:\nErrorID=5 (0x5): Line number=7: x");
        assert!(matches!(syntax, Error::Parse { line: Some(7), .. }), "{syntax:?}");
        let schema = refusal("Schema violation: unrecognized element\nElement 'foo', line 3");
        assert!(matches!(schema, Error::Parse { line: Some(3), .. }), "{schema:?}");
        let compile = refusal(
            "Error: mass must be positive\nObject name = b, id = 1, line = 12, column = -1",
        );
        assert!(matches!(compile, Error::Compile { line: Some(12), .. }), "{compile:?}");
    }

    #[test]
    fn place_is_path_line_col() {
        let e = refusal("bad, line 4").at(std::path::Path::new("a/b.xml"));
        assert!(e.to_string().starts_with("a/b.xml:4:1: "), "{e}");
    }
}
