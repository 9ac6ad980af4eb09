//! Colours that colour-blind readers can tell apart (Okabe and Ito, 2008), and the two house
//! themes. Colour always names the joint or the method; kind is shown by the pattern
//! (solid = achieved, dashed or crosses = commanded).

/// sRGB, 8 bits.
pub type Rgb = [u8; 3];

/// Blue: the command.
pub const BLUE: Rgb = [0, 114, 178];
/// Vermilion: error.
pub const VERMILION: Rgb = [213, 94, 0];
/// Bluish green.
pub const GREEN: Rgb = [0, 158, 115];
/// Reddish purple.
pub const PURPLE: Rgb = [204, 121, 167];
/// Orange.
pub const ORANGE: Rgb = [230, 159, 0];
/// Sky blue.
pub const SKY: Rgb = [86, 180, 233];
/// Yellow; too pale for lines on white, hence last.
pub const YELLOW: Rgb = [240, 228, 66];

/// Colours that differ by more than their shade.
pub(super) const COLORS: usize = 7;
/// Colours of lines, in the order of use.
const LIGHT: [Rgb; COLORS] = [BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, [90, 90, 90]];
const DARK: [Rgb; COLORS] =
    [SKY, ORANGE, [45, 200, 150], [230, 150, 195], YELLOW, [240, 110, 50], [190, 190, 190]];

/// Background, ink and lines of a chart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Theme {
    /// For paper.
    #[default]
    Light,
    /// For the studio and talks in dark rooms.
    Dark,
}

impl Theme {
    /// Paper.
    pub fn paper(self) -> Rgb {
        match self {
            Theme::Light => [255, 255, 255],
            Theme::Dark => [24, 27, 32],
        }
    }

    /// Text and axes; at least 7:1 against the paper.
    pub fn ink(self) -> Rgb {
        match self {
            Theme::Light => [38, 42, 48],
            Theme::Dark => [222, 226, 232],
        }
    }

    /// Secondary text (ticks, units).
    pub fn faint_ink(self) -> Rgb {
        match self {
            Theme::Light => [92, 98, 106],
            Theme::Dark => [160, 168, 178],
        }
    }

    /// Grid lines.
    pub fn grid(self) -> Rgb {
        match self {
            Theme::Light => [230, 232, 236],
            Theme::Dark => [50, 55, 63],
        }
    }

    /// Colour number `i`; past seven the same again, every second round nearer to the ink.
    pub fn line(self, i: usize) -> Rgb {
        let set = match self {
            Theme::Light => &LIGHT,
            Theme::Dark => &DARK,
        };
        let color = set[i % COLORS];
        if (i / COLORS).is_multiple_of(2) { color } else { mix(color, self.ink(), 0.5) }
    }

    /// Sequential scale, 0 to 1: from the paper to deep blue, even in lightness (heat maps).
    pub fn heat(self, share: f64) -> Rgb {
        let stops: [Rgb; 5] = match self {
            Theme::Light => {
                [[247, 250, 253], [186, 214, 235], [107, 174, 214], [33, 113, 181], [8, 48, 107]]
            }
            Theme::Dark => {
                [[30, 34, 40], [28, 66, 110], [33, 113, 181], [107, 174, 214], [222, 240, 250]]
            }
        };
        let x = if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 } * 4.0;
        let low = (x.floor() as usize).min(3);
        mix(stops[low], stops[low + 1], x - low as f64)
    }
}

/// Between two colours, `share` of the second.
pub fn mix(a: Rgb, b: Rgb, share: f64) -> Rgb {
    let one =
        |k: usize| (f64::from(a[k]) + (f64::from(b[k]) - f64::from(a[k])) * share).round() as u8;
    [one(0), one(1), one(2)]
}

/// As shares of one.
pub fn unit(c: Rgb) -> [f32; 3] {
    c.map(|x| f32::from(x) / 255.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn luminance(c: Rgb) -> f64 {
        let lin = c.map(|x| {
            let x = f64::from(x) / 255.0;
            if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
        });
        0.2126 * lin[0] + 0.7152 * lin[1] + 0.0722 * lin[2]
    }

    fn contrast(a: Rgb, b: Rgb) -> f64 {
        let (x, y) = (luminance(a).max(luminance(b)), luminance(a).min(luminance(b)));
        (x + 0.05) / (y + 0.05)
    }

    #[test]
    fn text_is_readable_in_both_themes() {
        for t in [Theme::Light, Theme::Dark] {
            assert!(contrast(t.ink(), t.paper()) >= 7.0);
            assert!(contrast(t.faint_ink(), t.paper()) >= 4.5);
            for i in 0..2 * COLORS {
                assert!(contrast(t.line(i), t.paper()) >= 2.0, "{t:?} {i}");
            }
        }
    }

    #[test]
    fn heat_grows_away_from_the_paper() {
        for t in [Theme::Light, Theme::Dark] {
            let c: Vec<f64> =
                (0..=20).map(|i| contrast(t.heat(f64::from(i) / 20.0), t.paper())).collect();
            assert!(c.windows(2).all(|w| w[1] >= w[0] - 1e-9), "{t:?} {c:?}");
        }
        assert_eq!(Theme::Light.heat(f64::NAN), Theme::Light.heat(0.0));
    }
}
