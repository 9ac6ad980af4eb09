//! Draws lines of text as pixels in the font of [`super::font`], with kerning.

use ab_glyph::{Font, FontRef, Glyph, PxScale, ScaleFont, point};

use super::font;

/// Both weights, parsed once.
#[derive(Debug)]
pub struct Letterer {
    regular: Option<FontRef<'static>>,
    bold: Option<FontRef<'static>>,
}

impl Default for Letterer {
    fn default() -> Self {
        // Built-in bytes; the tests check that they parse.
        Letterer {
            regular: FontRef::try_from_slice(font::REGULAR).ok(),
            bold: FontRef::try_from_slice(font::BOLD).ok(),
        }
    }
}

impl Letterer {
    fn face(&self, bold: bool) -> Option<&FontRef<'static>> {
        if bold { self.bold.as_ref() } else { self.regular.as_ref() }
    }

    /// Whether the font has this letter.
    pub fn has(&self, letter: char) -> bool {
        self.face(false).is_some_and(|f| f.glyph_id(letter).0 != 0)
    }

    /// Width of a line at `em_px` pixels an em.
    pub fn width(&self, text: &str, bold: bool, em_px: f32) -> f32 {
        self.layout(text, bold, em_px, (0.0, 0.0)).1
    }

    /// Calls `put(x, y, cover)` for every pixel that the line touches; its baseline begins at
    /// `at`, rounded to whole pixels so that horizontal strokes stay crisp.
    pub fn draw(
        &self,
        text: &str,
        bold: bool,
        em_px: f32,
        at: (f32, f32),
        mut put: impl FnMut(i64, i64, f32),
    ) {
        let Some(face) = self.face(bold) else { return };
        let (glyphs, _) = self.layout(text, bold, em_px, (at.0.round(), at.1.round()));
        for glyph in glyphs {
            let Some(outline) = face.outline_glyph(glyph) else { continue };
            let corner = outline.px_bounds().min;
            outline.draw(|x, y, cover| {
                put(corner.x as i64 + i64::from(x), corner.y as i64 + i64::from(y), cover.min(1.0));
            });
        }
    }

    fn layout(&self, text: &str, bold: bool, em_px: f32, at: (f32, f32)) -> (Vec<Glyph>, f32) {
        let Some(face) = self.face(bold) else { return (Vec::new(), 0.0) };
        // ab_glyph scales by ascent - descent, people think in ems.
        let em = face.units_per_em().unwrap_or(1000.0);
        let scale = PxScale::from(em_px * (face.ascent_unscaled() - face.descent_unscaled()) / em);
        let scaled = face.as_scaled(scale);
        let mut x = at.0;
        let mut last = None;
        let mut glyphs = Vec::new();
        for c in text.chars() {
            let id = face.glyph_id(c);
            if let Some(last) = last {
                x += scaled.kern(last, id);
            }
            glyphs.push(id.with_scale_and_position(scale, point(x, at.1)));
            x += scaled.h_advance(id);
            last = Some(id);
        }
        (glyphs, x - at.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_font_has_the_letters_that_we_use() {
        let l = Letterer::default();
        for c in "aZ09 .,·±×°²µσ–−()[]/=<>%".chars() {
            assert!(l.has(c), "no glyph for {c:?}");
        }
        assert!(l.width("precision", true, 20.0) > l.width("precision", false, 10.0));
        let mut ink = 0.0;
        l.draw("ink", false, 20.0, (2.0, 20.0), |_, _, cover| ink += cover);
        assert!(ink > 20.0);
    }
}
