//! The facts that decide the last bits of results: the kind of processor and the program.

use std::sync::OnceLock;

use robert_base::fsio;

use super::Error;

/// The kind of arithmetic and the program of this process.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Machine {
    /// `avx512+amx`, `avx512`, `avx2` and so on; see [`robert_linalg::numerics`].
    pub numerics: String,
    /// Sha-256 of the running program.
    pub binary_sha256: String,
}

impl Machine {
    /// The facts about this process. The program's file is read once.
    ///
    /// # Errors
    /// [`Error::Files`] when the program's file cannot be read.
    pub fn here() -> Result<Self, Error> {
        static SHA: OnceLock<String> = OnceLock::new();
        let sha = match SHA.get() {
            Some(sha) => sha,
            None => {
                // The link of the kernel leads to the program that runs, even after its file was
                // replaced.
                let sha = fsio::sha256_file(std::path::Path::new("/proc/self/exe"))?;
                SHA.get_or_init(|| sha)
            }
        };
        Ok(Machine { numerics: robert_linalg::numerics().to_owned(), binary_sha256: sha.clone() })
    }
}
