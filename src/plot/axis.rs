//! Axes: range, ticks, and numbers with as few digits as possible.

/// One axis of a panel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Axis {
    /// The quantity, with its unit.
    pub label: String,
    /// Its unit; shown in brackets. Empty = a pure number.
    pub unit: String,
    /// First and last value; `None` = the range of the data.
    pub range: Option<(f64, f64)>,
    /// Logarithmic scale.
    pub log: bool,
    /// Always show zero (bars, errors).
    pub from_zero: bool,
    /// Least range, so that rounding errors do not fill the panel.
    pub least: f64,
    /// Names instead of numbers at 0, 1, 2, ...
    pub names: Vec<String>,
}

impl Axis {
    /// An axis with a label and a unit.
    pub fn new(label: &str, unit: &str) -> Axis {
        Axis { label: label.to_owned(), unit: unit.to_owned(), ..Axis::default() }
    }

    /// Fixed ends.
    #[must_use]
    pub fn range(mut self, low: f64, high: f64) -> Axis {
        self.range = Some((low, high));
        self
    }

    /// With zero.
    #[must_use]
    pub fn from_zero(mut self) -> Axis {
        self.from_zero = true;
        self
    }

    /// Powers of ten.
    #[must_use]
    pub fn log(mut self) -> Axis {
        self.log = true;
        self
    }

    /// Sets the least range.
    #[must_use]
    pub fn least(mut self, span: f64) -> Axis {
        self.least = span;
        self
    }

    /// Categories.
    #[must_use]
    pub fn names(mut self, names: Vec<String>) -> Axis {
        self.names = names;
        self
    }

    /// `label (unit)`.
    pub fn text(&self) -> String {
        match (self.label.is_empty(), self.unit.is_empty()) {
            (_, true) => self.label.clone(),
            (true, false) => format!("({})", self.unit),
            _ => format!("{} ({})", self.label, self.unit),
        }
    }

    /// The ends that are drawn, for data between `low` and `high`.
    pub(super) fn ends(&self, low: f64, high: f64) -> (f64, f64) {
        if let Some((a, b)) = self.range
            && a.is_finite()
            && b.is_finite()
            && a < b
            && (!self.log || a > 0.0)
        {
            return (a, b);
        }
        if !self.names.is_empty() {
            return (-0.5, self.names.len() as f64 - 0.5);
        }
        let (mut low, mut high) = if low <= high { (low, high) } else { (0.0, 1.0) };
        if high - low < self.least && !self.log {
            let middle = 0.5 * (low + high);
            (low, high) = (middle - 0.5 * self.least, middle + 0.5 * self.least);
        }
        if self.log {
            let low = low.max(high * 1e-9).max(1e-300);
            let (a, b) = (low.log10(), high.max(low).log10());
            let room = 0.05 * (b - a).max(0.2);
            return (10_f64.powf(a - room), 10_f64.powf(b + room));
        }
        if self.from_zero {
            low = low.min(0.0);
            high = high.max(0.0);
        }
        if high - low < 1e-12 * high.abs().max(1e-6) {
            let half = (0.5 * high.abs()).max(0.5);
            return (low - half, high + half);
        }
        let room = 0.06 * (high - low);
        let open = |end: f64| if self.from_zero && end == 0.0 { 0.0 } else { room };
        (low - open(low), high + open(high))
    }

    /// The ends without margins.
    pub(super) fn tight(&self, low: f64, high: f64) -> (f64, f64) {
        let plain = !self.log && self.names.is_empty() && self.range.is_none();
        if plain && high > low { (low, high) } else { self.ends(low, high) }
    }

    /// Ticks inside the ends: place and text.
    pub(super) fn ticks(&self, ends: (f64, f64), wish: usize) -> Vec<(f64, String)> {
        if !self.names.is_empty() {
            return self.names.iter().enumerate().map(|(i, n)| (i as f64, n.clone())).collect();
        }
        if self.log {
            return log_ticks(ends);
        }
        even_ticks(ends, wish)
    }
}

fn step(span: f64, wish: usize) -> f64 {
    let raw = span / wish as f64;
    let power = 10_f64.powf(raw.log10().floor());
    let lead = raw / power;
    let nice = if lead <= 1.0 {
        1.0
    } else if lead <= 2.0 {
        2.0
    } else if lead <= 5.0 {
        5.0
    } else {
        10.0
    };
    nice * power
}

fn digits(step: f64) -> usize {
    (-(step.log10() + 1e-9).floor()).clamp(0.0, 9.0) as usize
}

fn log_ticks(ends: (f64, f64)) -> Vec<(f64, String)> {
    if ends.0 <= 0.0 {
        return Vec::new();
    }
    let (a, b) = (ends.0.log10().floor() as i32, ends.1.log10().ceil() as i32);
    let every = ((b - a) / 8).max(1);
    let at = |leads: &[f64]| {
        let mut ticks = Vec::new();
        for power in (a..=b).step_by(every as usize) {
            for lead in leads {
                let v = lead * 10_f64.powi(power);
                if v >= ends.0 * (1.0 - 1e-9) && v <= ends.1 * (1.0 + 1e-9) {
                    ticks.push((v, short(v)));
                }
            }
        }
        ticks
    };
    // Short axes get finer ticks, since one number alone is not a scale.
    let all: [&[f64]; 3] =
        [&[1.0], &[1.0, 2.0, 5.0], &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]];
    let from = usize::from(ends.1 / ends.0 < 100.0);
    let mut found = all[from..].iter().map(|leads| at(leads));
    found.find(|ticks| ticks.len() >= 3).unwrap_or_else(|| {
        let mut even = (4..10).map(|wish| even_ticks(ends, wish));
        even.find(|ticks| ticks.len() >= 3).unwrap_or_default()
    })
}

/// Round numbers at equal distances.
fn even_ticks(ends: (f64, f64), wish: usize) -> Vec<(f64, String)> {
    let step = step(ends.1 - ends.0, wish.max(2));
    let first = (ends.0 / step - 1e-9).ceil() as i64;
    let last = (ends.1 / step + 1e-9).floor() as i64;
    let digits = digits(step);
    let greatest = ends.0.abs().max(ends.1.abs());
    // Longer numbers are hard to read.
    let large = !(1e-4..1e5).contains(&greatest);
    (first..=last)
        .take(200)
        .map(|k| {
            let v = k as f64 * step;
            (v, if large { short(v) } else { minus(&format!("{v:.digits$}")) })
        })
        .collect()
}

/// 20k, 1.5M, 0.02.
fn short(v: f64) -> String {
    let a = v.abs();
    if a >= 1e13 {
        return minus(&format!("{v:.1e}"));
    }
    let (scaled, letter) = match a {
        a if a >= 1e9 => (v / 1e9, "G"),
        a if a >= 1e6 => (v / 1e6, "M"),
        a if a >= 1e3 => (v / 1e3, "k"),
        _ => (v, ""),
    };
    let text = if a > 0.0 && a < 1e-4 {
        // A product of a tick's number and its step: digits beyond the fourth are rounding.
        let text = format!("{v:.3e}");
        let (lead, power) = text.split_once('e').unwrap_or((&text, "0"));
        let lead = lead.trim_end_matches('0').trim_end_matches('.');
        return minus(&format!("{lead}e{power}"));
    } else {
        format!("{scaled:.4}")
    };
    let text = text.trim_end_matches('0').trim_end_matches('.');
    minus(&format!("{}{letter}", if text.is_empty() { "0" } else { text }))
}

/// A true minus sign; and no "-0".
fn minus(text: &str) -> String {
    let zero = text.trim_start_matches('-').chars().all(|c| c == '0' || c == '.');
    match text.strip_prefix('-') {
        Some(rest) if zero => rest.to_owned(),
        Some(rest) => format!("−{rest}"),
        None => text.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(axis: &Axis, ends: (f64, f64)) -> Vec<String> {
        axis.ticks(ends, 5).into_iter().map(|t| t.1).collect()
    }

    #[test]
    fn ticks_are_round_and_inside() {
        let a = Axis::new("angle", "rad");
        assert_eq!(texts(&a, (-0.31, 1.02)), ["0.0", "0.5", "1.0"]);
        assert_eq!(texts(&a, (-1.2, 1.2)), ["−1.0", "−0.5", "0.0", "0.5", "1.0"]);
        assert_eq!(texts(&a, (0.0, 300_000.0)), ["0", "100k", "200k", "300k"]);
        assert_eq!(texts(&a.clone().log(), (0.009, 1.1)), ["0.01", "0.1", "1"]);
        assert_eq!(
            texts(&a.clone().log(), (0.02, 3.0)),
            ["0.02", "0.05", "0.1", "0.2", "0.5", "1", "2"]
        );
        let short = ["0.0025", "0.0030", "0.0035", "0.0040", "0.0045"];
        assert_eq!(texts(&a.clone().log(), (0.0021, 0.0048)), short);
        assert_eq!(texts(&a, (0.0, 3.1e-12)), ["0", "1e-12", "2e-12", "3e-12"]);
        assert_eq!(texts(&a, (0.0, 1e300)).last().unwrap(), "1.0e300");
        assert_eq!(texts(&a, (-3e38, 0.0)).first().unwrap(), "−3.0e38");
        assert_eq!(a.text(), "angle (rad)");
    }

    #[test]
    fn rounding_does_not_fill_a_panel() {
        let a = Axis::new("angle", "rad").least(1e-3);
        let (low, high) = a.ends(0.5, 0.5 + 1e-10);
        assert!((high - low - 1.12e-3).abs() < 1e-6 && low < 0.5 && high > 0.5, "{low} {high}");
        assert_eq!(texts(&a, (low, high)), ["0.4995", "0.5000", "0.5005"]);
        assert_eq!(a.ends(0.0, 1.0), Axis::default().ends(0.0, 1.0));
    }

    #[test]
    fn degenerate_data_still_have_an_axis() {
        let a = Axis::new("", "");
        for (low, high) in [(3.0, 3.0), (0.0, 0.0), (f64::INFINITY, f64::NEG_INFINITY)] {
            let (x, y) = a.ends(low, high);
            assert!(x < y && x.is_finite() && y.is_finite());
            assert!(!a.ticks((x, y), 5).is_empty());
        }
        let (x, y) = a.clone().log().ends(0.0, 0.0);
        assert!(x > 0.0 && y > x);
        assert_eq!(a.clone().from_zero().ends(1.0, 2.0).0, 0.0);
    }
}
