//! Text over a picture: title, caption line and legend, drawn on the CPU after the readback.
//!
//! Text is drawn at the final resolution with its own antialiasing and not in the 3-D pass, so it
//! is sharp at any sample count.

use super::Picture;
use robert_base::units::significant;
use robert_plot::Letterer;
use robert_plot::palette::Rgb;

/// The shape of a legend entry.
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
    /// The meaning of the entry.
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
    /// Letters 1.5 times as large, for pictures that are shown smaller, as in strips.
    pub large: bool,
    /// A text that is as wide as the line of any frame of a film or strip. The letters of the line have
    /// the size at which this fits, so that they do not change from frame to frame. May be empty.
    pub widest: String,
}

impl Caption {
    /// `frame 40 · 2.00 s · Precision 0.0312°` in the bottom left corner; the Precision
    /// in the unit that is given with it.
    pub fn moment(frame: u32, secs: f64, precision: Option<(f64, &str)>) -> String {
        match precision {
            Some((p, unit)) => {
                let degrees = unit == "\u{b0}";
                let p = if degrees && p < LEAST_DEG { "<0.001".to_owned() } else { significant(p) };
                let gap = if degrees { "" } else { " " };
                format!("frame {frame} · {secs:.2} s · Precision {p}{gap}{unit}")
            }
            None => format!("frame {frame} · {secs:.2} s"),
        }
    }
}

/// Errors below this are all written alike, degrees: nobody sees them.
const LEAST_DEG: f64 = 0.001;
const INK: Rgb = [245, 247, 250];
const PANEL: Rgb = [22, 26, 32];
const PANEL_OPACITY: f32 = 0.66;
/// Free space before and behind a text, height of its panel, and from one key of the legend to
/// the next; in letter sizes.
const PAD: f32 = 0.5;
const LINE: f32 = 1.65;
const STEP: f32 = 1.45;
/// Letters below this cannot be read.
const LEAST_PX: f32 = 9.0;
/// In pictures with fewer lines than this the letters of the legend are smaller.
const SHRINKS_PX: f32 = 720.0;
/// The smallest letters of the legend.
const LEGEND_LEAST_PX: f32 = 10.0;
/// The largest share of a picture that a legend may cover.
const LEGEND_SHARE: f32 = 0.12;
/// A picture narrower than this shows only the line.
const SMALL_PX: f32 = 160.0;
/// Between the parts of a line.
const PARTS: &str = " · ";

/// A text and its panel `[x, y, width, height]`, pixels.
#[derive(Debug)]
struct Row {
    text: String,
    bold: bool,
    px: f32,
    frame: [f32; 4],
}

/// The layout of all parts.
#[derive(Debug, Default)]
struct Plan {
    rows: Vec<Row>,
    /// Height of the legend's letters, and its frame.
    legend_px: f32,
    legend: Option<[f32; 4]>,
}

/// Draws captions.
#[derive(Debug, Default)]
pub(super) struct Captioner(Letterer);

impl Captioner {
    /// Whether a picture of this size is too small for the legend.
    pub(super) fn drops_legend(&self, width: u32, height: u32, caption: &Caption) -> bool {
        let plan = self.plan(width as f32, height as f32, caption);
        !caption.legend.is_empty() && plan.legend.is_none()
    }

    /// Draws the caption into the corners.
    pub(super) fn draw(&self, picture: &mut Picture, caption: &Caption) {
        let plan = self.plan(picture.width as f32, picture.height as f32, caption);
        for row in &plan.rows {
            let [x, y, _, h] = row.frame;
            rounded(picture, row.frame, row.px * 0.35, PANEL, PANEL_OPACITY);
            let at = (x + row.px * PAD, y + 0.5 * h + 0.36 * row.px);
            self.text(picture, &row.text, row.bold, row.px, at, INK);
        }
        if let Some(frame) = plan.legend {
            self.legend(picture, &caption.legend, plan.legend_px, frame);
        }
    }

    /// The texts that fit without crossing the margin or each other.
    fn plan(&self, width: f32, height: f32, caption: &Caption) -> Plan {
        // 15 px on 480 lines; never below what the font can show legibly.
        let scale = if caption.large { 1.5 } else { 1.0 };
        let px = (height.min(0.75 * width) / 32.0).clamp(11.0, 64.0) * scale;
        let margin = (px * 0.8).round();
        let room = width - 2.0 * margin;
        // Larger letters would hide what a strip shows, and in small pictures the robot.
        let shrinks = (height.min(0.75 * width) / SHRINKS_PX).min(1.0);
        let legend_px = (px / scale * shrinks).max(LEGEND_LEAST_PX);
        let mut plan = Plan { legend_px, ..Plan::default() };
        let mut top = margin;
        // Thumbnails are too small for both.
        let small = width < SMALL_PX || height < 0.6 * SMALL_PX;
        if !caption.title.is_empty() && !small {
            let title = self.shortened(&caption.title, px * 1.1, room - 2.0 * PAD * px * 1.1);
            let row = self.row(title, true, px * 1.1, margin, margin);
            top += row.frame[3] + 0.4 * px;
            plan.rows.push(row);
        }
        let mut bottom = height - margin;
        if !caption.line.is_empty() {
            let (lines, px) = self.wrapped(&caption.line, &caption.widest, px, room);
            let step = px * LINE * 1.08;
            let tall = step * lines.len() as f32;
            if tall <= 0.5 * height && top + tall <= bottom {
                bottom -= tall;
                for (i, line) in lines.into_iter().enumerate() {
                    plan.rows.push(self.row(line, false, px, margin, bottom + step * i as f32));
                }
            }
        }
        if !caption.legend.is_empty() && !small {
            let px = legend_px;
            let widest = caption.legend.iter().map(|k| self.width(&k.text, false, px));
            let w = widest.fold(0.0, f32::max) + px * (2.0 + 2.0 * PAD);
            let h = px * (STEP * caption.legend.len() as f32 + PAD);
            let x = width - margin - w;
            // Top right, or below the title where both do not fit beside each other.
            let beside = plan
                .rows
                .first()
                .is_none_or(|r| r.frame[1] > margin || r.frame[0] + r.frame[2] + 0.5 * px <= x);
            let y = if beside { margin } else { top };
            let fits = x >= margin && y + h + 0.4 * px <= bottom;
            if fits && w * h <= LEGEND_SHARE * width * height {
                plan.legend = Some([x, y, w, h]);
            }
        }
        plan
    }

    fn row(&self, text: String, bold: bool, px: f32, x: f32, y: f32) -> Row {
        let width = self.width(&text, bold, px) + 2.0 * PAD * px;
        Row { text, bold, px, frame: [x, y, width, px * LINE] }
    }

    /// Truncates with an ellipsis if the text is wider.
    fn shortened(&self, text: &str, px: f32, room: f32) -> String {
        let fits = |t: &str| self.width(t, true, px) <= room;
        if fits(text) {
            return text.to_owned();
        }
        let ends = text.char_indices().map(|(i, _)| i).rev();
        let mut cut = ends.map(|end| format!("{}…", text.get(..end).unwrap_or("").trim_end()));
        cut.find(|t| fits(t)).unwrap_or_default()
    }

    /// The line at a size at which `widest` fits as well: a little smaller, or in several rows;
    /// `None` if not even a part of it fits.
    fn wrapped(&self, line: &str, widest: &str, px: f32, room: f32) -> (Vec<String>, f32) {
        let fits = |t: &str, px: f32| self.width(t, false, px) + 2.0 * PAD * px <= room;
        let smaller = [1.0, 0.9, 0.8].map(|k| (px * k).max(LEAST_PX));
        let both = |px: f32| fits(line, px) && fits(widest, px);
        if let Some(px) = smaller.into_iter().find(|px| both(*px)) {
            return (vec![line.to_owned()], px);
        }
        for px in [px, px.min(11.0), LEAST_PX] {
            let mut rows: Vec<String> = Vec::new();
            for part in line.split(PARTS) {
                match rows.last_mut() {
                    Some(row) if fits(&format!("{row}{PARTS}{part}"), px) => {
                        row.push_str(PARTS);
                        row.push_str(part);
                    }
                    _ => rows.push(part.to_owned()),
                }
            }
            if rows.iter().all(|r| fits(r, px)) {
                return (rows, px);
            }
        }
        (Vec::new(), px)
    }

    fn legend(&self, picture: &mut Picture, keys: &[Key], px: f32, frame: [f32; 4]) {
        let [x, y, ..] = frame;
        let pad = px * PAD;
        let step = px * STEP;
        rounded(picture, frame, px * 0.35, PANEL, PANEL_OPACITY);
        for (i, key) in keys.iter().enumerate() {
            let mid = y + 0.5 * pad + step * (i as f32 + 0.5);
            swatch(picture, key, x + pad, mid, px);
            let baseline = mid + 0.36 * px;
            self.text(picture, &key.text, false, px, (x + pad + px * 2.0, baseline), INK);
        }
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
    fn nothing_is_cut_off_or_covered() {
        let key =
            |text: &str| Key { swatch: Swatch::Ghost, color: [0, 114, 178], text: text.into() };
        let caption = Caption {
            title: "Fire a handgun".into(),
            line: format!("{} · computed-torque", Caption::moment(180, 9.0, Some((0.612, "mrad")))),
            legend: ["achieved", "command, small error", "command, large error", "keyframe"]
                .map(key)
                .to_vec(),
            ..Caption::default()
        };
        let size = |c: &Caption| Captioner::default().plan(640.0, 480.0, c).rows[0].px;
        assert!(size(&Caption { large: true, ..caption.clone() }) > 1.4 * size(&caption));
        let sizes = [
            (640, 480),
            (360, 480),
            (300, 900),
            (280, 210),
            (200, 150),
            (160, 120),
            (64, 48),
            (8, 8),
        ];
        for (w, h) in sizes.map(|(w, h)| (w as f32, h as f32)) {
            let plan = Captioner::default().plan(w, h, &caption);
            let frames: Vec<[f32; 4]> =
                plan.rows.iter().map(|r| r.frame).chain(plan.legend).collect();
            for (i, [x, y, width, height]) in frames.iter().copied().enumerate() {
                assert!(x >= 0.0 && y >= 0.0, "{w}x{h}: {frames:?}");
                assert!(x + width <= w && y + height <= h, "{w}x{h}: {frames:?}");
                for [ox, oy, ow, oh] in frames[..i].iter().copied() {
                    let apart = ox + ow <= x || x + width <= ox || oy + oh <= y || y + height <= oy;
                    assert!(apart, "{w}x{h}: {frames:?}");
                }
            }
            let said: String =
                plan.rows.iter().filter(|r| !r.bold).map(|r| r.text.clone() + PARTS).collect();
            if w >= 160.0 {
                assert_eq!(said.trim_end_matches(PARTS), caption.line, "{w}x{h}: all of the line");
            }
            assert_eq!(plan.legend.is_some(), w >= 300.0, "{w}x{h}");
            assert_eq!(plan.rows.iter().any(|r| r.bold), w >= 160.0, "{w}x{h}");
        }
    }

    #[test]
    fn letters_keep_their_size_from_frame_to_frame() {
        let widest = "frame 888 · 88.88 s · Precision 8.8888° · computed-torque".to_owned();
        let sizes = [0, 33, 200].map(|frame| {
            let line = Caption::moment(frame, f64::from(frame) / 20.0, Some((0.0534, "\u{b0}")));
            let caption =
                Caption { line, large: true, widest: widest.clone(), ..Caption::default() };
            let plan = Captioner::default().plan(360.0, 480.0, &caption);
            plan.rows.first().unwrap().px
        });
        assert!(sizes.iter().all(|s| *s == sizes[0]), "{sizes:?}");
    }

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
            ..Caption::default()
        };
        for (w, h) in [(1, 1), (30, 10), (320, 240)] {
            let mut p = Picture::filled(w, h, [128; 3]);
            Captioner::default().draw(&mut p, &caption);
            assert_eq!(p.rgba.len(), (4 * w * h) as usize);
        }
        assert_eq!(caption.line, "frame 40 · 2.00 s · Precision 0.0312 rad");
        let tiny = |unit| Caption::moment(1, 0.05, Some((2.04e-6, unit)));
        assert_eq!(tiny("\u{b0}"), "frame 1 · 0.05 s · Precision <0.001°");
        assert_eq!(tiny("m"), "frame 1 · 0.05 s · Precision 2.04e-6 m");
    }
}
