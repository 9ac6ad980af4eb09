//! Units and the clock. All Rust code uses radians, metres and seconds. Time is counted in whole
//! frames of 1/20 s, so that a clip and its rollout never drift apart.

/// Length of one control step (one frame), seconds: 20 Hz as in the paper.
pub const CTRL_DT: f64 = 0.05;

/// Frames per second.
pub const FPS: u32 = 20;

/// Simulator step, seconds. Another number of substeps is another learning problem, so it is the
/// same for every robot.
pub const SIM_DT: f64 = 0.005;

/// Simulator steps in one control step.
pub const SUBSTEPS: usize = 10;

/// The unit of one joint coordinate.
#[derive(
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
    Hash,
    serde::Serialize,
    serde::Deserialize,
    schemars::JsonSchema,
)]
#[serde(rename_all = "lowercase")]
pub enum Unit {
    /// Hinge joints.
    Rad,
    /// Slide joints, metres.
    M,
}

impl Unit {
    /// Symbol for tables and axes.
    pub fn symbol(self) -> &'static str {
        match self {
            Unit::Rad => "rad",
            Unit::M => "m",
        }
    }
}

/// A count as people type it: `400000`, `400_000`, `400k`, `2.5M`, `4e5`.
///
/// # Errors
/// A sentence for the command line if the text is not a whole number below 2^53.
pub fn count(text: &str) -> Result<u64, String> {
    let plain = text.trim().replace('_', "");
    if let Ok(n) = plain.parse::<u64>() {
        return Ok(n);
    }
    let (digits, unit) = match plain.char_indices().last() {
        Some((at, 'k' | 'K')) => (&plain[..at], 1e3),
        Some((at, 'm' | 'M')) => (&plain[..at], 1e6),
        Some((at, 'g' | 'G')) => (&plain[..at], 1e9),
        _ => (plain.as_str(), 1.0),
    };
    let value = digits.parse::<f64>().unwrap_or(f64::NAN) * unit;
    // 2.3e6 and .0023G are whole numbers that binary fractions do not represent exactly.
    let whole = value.round();
    if (0.0..9.007e15).contains(&whole) && (value - whole).abs() <= 1e-9 * whole.max(1.0) {
        return Ok(whole as u64);
    }
    Err(format!("{text:?} is not a whole number; write 400000, 400k, 2.5M or 4e5"))
}

/// Three significant digits in plain decimals: `0.0312`, `0.000421`, `12.3`. Values below 1e-5 have an exponent:
/// `3.81e-8`.
///
/// Values below 1e-9 of a unit are rounding errors and are shown as 0.
pub fn significant(value: f64) -> String {
    if !value.is_finite() || value.abs() < 1e-9 {
        return if value.is_finite() { "0".to_owned() } else { value.to_string() };
    }
    // The exponent after rounding: 0.0009996 is shown as 0.00100.
    let rounded = format!("{value:.2e}");
    let exponent: i32 = rounded.split_once('e').and_then(|(_, e)| e.parse().ok()).unwrap_or(0);
    if exponent < -5 {
        return rounded;
    }
    format!("{value:.*}", usize::try_from(2 - exponent).unwrap_or(0))
}

/// A fixed number of decimals, without the sign of a value that rounds to zero.
pub fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(rest) if rest.bytes().all(|b| matches!(b, b'0' | b'.')) => rest.to_owned(),
        _ => text,
    }
}

/// The unit in which figures around `typical` are short, as factor and symbol. Only `rad` and `m`
/// have smaller units.
pub fn short_unit(unit: &str, typical: f64) -> (f64, String) {
    let known = unit == "rad" || unit == "m";
    match typical.abs() {
        x if known && (1e-9..1e-5).contains(&x) => (1e6, format!("\u{b5}{unit}")),
        x if known && (1e-5..1e-2).contains(&x) => (1e3, format!("m{unit}")),
        _ => (1.0, unit.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_read_as_typed() {
        let good = [
            ("0", 0),
            ("400000", 400_000),
            ("400_000", 400_000),
            ("400k", 400_000),
            (" 2.5M ", 2_500_000),
            ("2.3e6", 2_300_000),
            ("1g", 1_000_000_000),
            ("18446744073709551615", u64::MAX),
        ];
        for (text, n) in good {
            assert_eq!(count(text), Ok(n), "{text}");
        }
        for bad in ["", "k", "1.5", "0.0001k", "-3", "4 00", "4kk", "nan", "inf", "1e30", "\u{3b1}"]
        {
            let said = count(bad).unwrap_err();
            assert!(said.contains("400k"), "{bad}: {said}");
        }
    }

    #[test]
    fn figures_have_three_digits() {
        let cases = [
            (0.0312, "0.0312"),
            (0.000_421_4, "0.000421"),
            (0.000_999_6, "0.00100"),
            (12.345, "12.3"),
            (1234.5, "1234"),
            (-0.5, "-0.500"),
            (0.0, "0"),
            (3e-12, "0"),
            (3.812e-8, "3.81e-8"),
            (-0.000_012_34, "-0.0000123"),
        ];
        for (value, text) in cases {
            assert_eq!(significant(value), text);
        }
        assert_eq!((fixed(-0.000_04, 4), fixed(-0.000_06, 4)), ("0.0000".into(), "-0.0001".into()));
        assert_eq!((fixed(-0.0, 0), fixed(-1.0, 0)), ("0".into(), "-1".into()));
        assert_eq!(short_unit("rad", 0.2), (1.0, "rad".into()));
        assert_eq!(short_unit("m", 0.002), (1e3, "mm".into()));
        assert_eq!(short_unit("rad", 3e-6), (1e6, "\u{b5}rad".into()));
        assert_eq!(short_unit("rad or m", 3e-6).0, 1.0);
        assert_eq!(short_unit("rad", 0.0).0, 1.0);
    }
}
