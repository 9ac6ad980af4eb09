//! The built-in font of charts and captions: Noto Sans (SIL Open Font License 1.1). A picture looks
//! the same on a machine without fonts.

/// Noto Sans Regular, TrueType.
pub const REGULAR: &[u8] = notosans::REGULAR_TTF;
/// Noto Sans Bold, TrueType.
pub const BOLD: &[u8] = notosans::BOLD_TTF;
