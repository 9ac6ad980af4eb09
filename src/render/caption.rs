//! Text over a picture: title, caption line, legend; drawn on the CPU after the readback.
//!
//! Text is drawn at the final resolution with its own antialiasing, never through the 3-D pass:
//! that is what keeps it sharp at any sample count.

use super::Picture;
use crate::plot::Letterer;
use crate::plot::palette::Rgb;
use crate::units::significant;

/// How a legend entry is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Swatch {
    /// Solid block: achieved.
    Solid,
    /// Outlined, half filled: a ghost.
    Ghost,
    /// A short line: a trail.
    Line,
    /// A cross: a commanded mark.
    Cross,
}

/// One line of the legend.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Key {
    /// Its sign.
    pub swatch: Swatch,
    /// Its colour.
    pub color: Rgb,
    /// What it means.
    pub text: String,
}

/// Text over a picture. Empty parts are not drawn.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Caption {
    /// Top left, bold.
    pub title: String,
    /// Bottom left: frame, time, Precision.
    pub line: String,
    /// Top right.
    pub legend: Vec<Key>,
}

impl Caption {
    /// `frame 40 · 2.00 s · Precision 0.0312 rad` in the bottom left corner; the Precision
    /// in the unit that is given with it.
    pub fn moment(frame: u32, secs: f64, precision: Option<(f64, &str)>) -> String {
        match precision {
            Some((p, unit)) => {
                let p = significant(p);
                format!("frame {frame} · {secs:.2} s · Precision {p} {unit}")
            }
            None => format!("frame {frame} · {secs:.2} s"),
        }
    }
}

const INK: Rgb = [245, 247, 250];
const PANEL: Rgb = [22, 26, 32];
const PANEL_OPACITY: f32 = 0.66;

/// Draws captions.
#[derive(Debug, Default)]
pub(super) struct Captioner(Letterer);

impl Captioner {
    /// Draws the caption into the corners.
    pub(super) fn draw(&self, picture: &mut Picture, caption: &Caption) {
        // 15 px on 480 lines; never below what the font can show legibly.
        let px = (picture.height as f32 / 32.0).clamp(11.0, 64.0);
        let margin = (px * 0.8).round();
        let bottom = picture.height as f32 - margin;
        if !caption.title.is_empty() {
            let panel = self.panel(picture, &caption.title, true, px * 1.1, margin, margin);
            self.text(picture, &caption.title, true, px * 1.1, panel, INK);
        }
        if !caption.line.is_empty() {
            let panel = self.panel(picture, &caption.line, false, px, margin, -bottom);
            self.text(picture, &caption.line, false, px, panel, INK);
        }
        self.legend(picture, &caption.legend, px, margin);
    }

    fn legend(&self, picture: &mut Picture, keys: &[Key], px: f32, margin: f32) {
        if keys.is_empty() {
            return;
        }
        let pad = px * 0.5;
        let step = px * 1.45;
        let widest = keys.iter().map(|k| self.width(&k.text, false, px)).fold(0.0, f32::max);
        let width = widest + px * 2.0 + 2.0 * pad;
        let height = step * keys.len() as f32 + pad;
        let x = picture.width as f32 - margin - width;
        // Top right: the caption line at the bottom may be as wide as the picture.
        let y = margin;
        rounded(picture, [x, y, width, height], px * 0.35, PANEL, PANEL_OPACITY);
        for (i, key) in keys.iter().enumerate() {
            let top = y + 0.5 * pad + step * i as f32;
            let mid = top + 0.5 * step;
            swatch(picture, key, x + pad, mid, px);
            let baseline = mid + 0.36 * px;
            self.text(picture, &key.text, false, px, (x + pad + px * 2.0, baseline), INK);
        }
    }

    /// Draws the panel behind a text; gives its baseline. A negative `y` is the lower edge.
    fn panel(
        &self,
        picture: &mut Picture,
        text: &str,
        bold: bool,
        px: f32,
        x: f32,
        y: f32,
    ) -> (f32, f32) {
        let pad = px * 0.5;
        let height = px * 1.65;
        let width = self.width(text, bold, px) + 2.0 * pad;
        let top = if y < 0.0 { -y - height } else { y };
        rounded(picture, [x, top, width, height], px * 0.35, PANEL, PANEL_OPACITY);
        (x + pad, top + 0.5 * height + 0.36 * px)
    }

    fn width(&self, text: &str, bold: bool, px: f32) -> f32 {
        self.0.width(text, bold, px)
    }

    /// Draws one line with its baseline starting at `at`.
    fn text(
        &self,
        picture: &mut Picture,
        text: &str,
        bold: bool,
        px: f32,
        at: (f32, f32),
        ink: Rgb,
    ) {
        self.0.draw(text, bold, px, at, |x, y, cover| {
            // A slight gain: thin light strokes on dark look thinner than they are.
            blend(picture, x, y, ink, (cover * 1.15).min(1.0));
        });
    }
}

fn blend(picture: &mut Picture, x: i64, y: i64, color: Rgb, opacity: f32) {
    if x < 0 || y < 0 || x >= i64::from(picture.width) || y >= i64::from(picture.height) {
        return;
    }
    let at = 4 * (y as usize * picture.width as usize + x as usize);
    let Some(p) = picture.rgba.get_mut(at..at + 3) else { return };
    for (p, c) in p.iter_mut().zip(color) {
        *p = (f32::from(*p) + (f32::from(c) - f32::from(*p)) * opacity).round() as u8;
    }
}

/// Fills a rectangle `[x, y, width, height]` with round corners, antialiased.
fn rounded(picture: &mut Picture, r: [f32; 4], radius: f32, color: Rgb, opacity: f32) {
    let [x, y, w, h] = r;
    let (cx, cy) = (x + 0.5 * w, y + 0.5 * h);
    for py in y.floor() as i64..=(y + h).ceil() as i64 {
        for px in x.floor() as i64..=(x + w).ceil() as i64 {
            // Signed distance to the rounded rectangle.
            let dx = (px as f32 + 0.5 - cx).abs() - 0.5 * w + radius;
            let dy = (py as f32 + 0.5 - cy).abs() - 0.5 * h + radius;
            let outside = dx.max(0.0).hypot(dy.max(0.0)) + dx.max(dy).min(0.0) - radius;
            let cover = (0.5 - outside).clamp(0.0, 1.0);
            if cover > 0.0 {
                blend(picture, px, py, color, cover * opacity);
            }
        }
    }
}

fn swatch(picture: &mut Picture, key: &Key, x: f32, mid: f32, px: f32) {
    let (w, h) = (px * 1.4, px * 0.8);
    let y = mid - 0.5 * h;
    match key.swatch {
        Swatch::Solid => rounded(picture, [x, y, w, h], px * 0.15, key.color, 1.0),
        Swatch::Ghost => {
            rounded(picture, [x, y, w, h], px * 0.15, key.color, 0.55);
            let t = (px / 9.0).max(1.0);
            for edge in [[x, y, w, t], [x, y + h - t, w, t], [x, y, t, h], [x + w - t, y, t, h]] {
                rounded(picture, edge, 0.0, key.color, 0.95);
            }
        }
        Swatch::Line => {
            let t = (px / 5.0).max(2.0);
            rounded(picture, [x, mid - 0.5 * t, w, t], 0.5 * t, key.color, 1.0);
        }
        Swatch::Cross => {
            let half = h * 0.5;
            let steps = (half * 4.0).ceil() as i32;
            for k in -steps..=steps {
                let d = half * k as f32 / steps as f32;
                let t = (px / 8.0).max(1.5);
                let cx = x + 0.5 * w + d - 0.5 * t;
                rounded(picture, [cx, mid + d - 0.5 * t, t, t], 0.5 * t, key.color, 0.6);
                rounded(picture, [cx, mid - d - 0.5 * t, t, t], 0.5 * t, key.color, 0.6);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn caption_stays_inside_any_picture() {
        let caption = Caption {
            title: "a name far longer than the picture is wide, without end".into(),
            line: Caption::moment(40, 2.0, Some((0.0312, "rad"))),
            legend: vec![Key {
                swatch: Swatch::Cross,
                color: [0, 114, 178],
                text: "command".into(),
            }],
        };
        for (w, h) in [(1, 1), (30, 10), (320, 240)] {
            let mut p = Picture::filled(w, h, [128; 3]);
            Captioner::default().draw(&mut p, &caption);
            assert_eq!(p.rgba.len(), (4 * w * h) as usize);
        }
        assert_eq!(caption.line, "frame 40 · 2.00 s · Precision 0.0312 rad");
    }
}
