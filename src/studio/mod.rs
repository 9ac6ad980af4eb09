//! The web studio.
