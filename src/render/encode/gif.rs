//! GIF: one palette for as long as possible, ordered dither, and only the changes between frames.
//!
//! One palette per frame (as in most encoders) flickers, and error diffusion changes a static
//! background, so that every frame must be stored completely. With a fixed dither pattern an
//! unchanged pixel keeps its index and costs nothing.

use color_quant::NeuQuant;

use super::fail;
use super::film::{Encode, Film};
use crate::{Error, Picture};

/// Colours; one index is kept for "as before".
const COLORS: usize = 255;
const AS_BEFORE: u8 = 255;
/// Bits per channel of the lookup table.
const BITS: u32 = 6;
/// Mean squared error above which the film gets a new palette.
const WORN_OUT: f64 = 90.0;
/// Bayer 4x4.
const PATTERN: [i16; 16] = [0, 8, 2, 10, 12, 4, 14, 6, 3, 11, 1, 9, 15, 7, 13, 5];

pub(super) struct Gif {
    encoder: gif::Encoder<Vec<u8>>,
    palette: Option<Palette>,
    shown: Vec<u8>,
    /// GIF counts hundredths of a second: the remainder is carried so that films keep time.
    clock: (u32, u32),
    fps: u32,
}

struct Palette {
    quant: NeuQuant,
    table: Vec<u16>,
    rgb: Vec<u8>,
}

impl Palette {
    fn of(picture: &Picture) -> Palette {
        // The palette is fitted to about 40,000 samples; small pictures are sampled repeatedly.
        let pixels = (picture.rgba.len() / 4).max(1);
        let every = (pixels / 40_000).clamp(1, 10) as i32;
        let lessons = picture.rgba.repeat((40_000 / pixels).max(1));
        let quant = NeuQuant::new(every, COLORS, &lessons);
        let rgb = quant.color_map_rgb();
        Palette { quant, table: vec![u16::MAX; 1 << (3 * BITS)], rgb }
    }

    fn index(&mut self, rgb: [u8; 3]) -> u8 {
        let shift = 8 - BITS;
        let slot = rgb.iter().fold(0, |s, c| s << BITS | usize::from(c >> shift));
        let found = self.table[slot];
        if let Ok(index) = u8::try_from(found) {
            return index;
        }
        let middle = rgb.map(|c| (c >> shift << shift) | 1 << (shift - 1));
        let index = self.quant.index_of(&[middle[0], middle[1], middle[2], 255]).min(COLORS - 1);
        self.table[slot] = index as u16;
        index as u8
    }

    /// Mean squared error on a sample.
    fn error(&mut self, picture: &Picture) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0_f64);
        for p in picture.rgba.chunks_exact(4).step_by(97) {
            let at = 3 * usize::from(self.index([p[0], p[1], p[2]]));
            for (a, b) in p.iter().zip(&self.rgb[at..at + 3]) {
                sum += (f64::from(*a) - f64::from(*b)).powi(2);
            }
            count += 1.0;
        }
        sum / count.max(1.0)
    }
}

impl Gif {
    pub(super) fn new(film: &Film) -> Result<Gif, Error> {
        let (Ok(w), Ok(h)) = (u16::try_from(film.width), u16::try_from(film.height)) else {
            return Err(Error::Encode { format: "gif", reason: "more than 65535 px".to_owned() });
        };
        let mut encoder = gif::Encoder::new(Vec::new(), w, h, &[]).map_err(fail("gif"))?;
        encoder.set_repeat(gif::Repeat::Infinite).map_err(fail("gif"))?;
        let fps = film.fps.max(1);
        Ok(Gif { encoder, palette: None, shown: Vec::new(), clock: (0, 0), fps })
    }

    fn delay(&mut self) -> u16 {
        let (frame, spent) = self.clock;
        let until = (frame + 1) * 100 / self.fps;
        self.clock = (frame + 1, until);
        (until - spent) as u16
    }
}

impl Encode for Gif {
    fn push(&mut self, picture: &Picture) -> Result<(), Error> {
        let worn = match &mut self.palette {
            None => true,
            Some(p) => p.error(picture) > WORN_OUT,
        };
        if worn {
            self.palette = Some(Palette::of(picture));
            self.shown.clear();
        }
        let delay = self.delay();
        let Some(palette) = self.palette.as_mut() else { return Err(Error::NoFrames) };
        let (w, h) = (picture.width as usize, picture.height as usize);
        let mut indices = vec![0_u8; w * h];
        for (i, p) in picture.rgba.chunks_exact(4).enumerate() {
            let nudge = (PATTERN[(i / w % 4) * 4 + i % w % 4] - 7) / 2;
            let c = |k: usize| (i16::from(p[k]) + nudge).clamp(0, 255) as u8;
            indices[i] = palette.index([c(0), c(1), c(2)]);
        }
        let (mut x0, mut y0, mut x1, mut y1) = (w, h, 0, 0);
        if self.shown.is_empty() {
            (x0, y0, x1, y1) = (0, 0, w - 1, h - 1);
        } else {
            for (i, _) in indices.iter().zip(&self.shown).enumerate().filter(|(_, (a, b))| a != b) {
                let (x, y) = (i % w, i / w);
                (x0, y0, x1, y1) = (x0.min(x), y0.min(y), x1.max(x), y1.max(y));
            }
        }
        if x0 > x1 {
            (x0, y0, x1, y1) = (0, 0, 0, 0);
        }
        let mut buffer = Vec::with_capacity((x1 - x0 + 1) * (y1 - y0 + 1));
        for y in y0..=y1 {
            for x in x0..=x1 {
                let i = y * w + x;
                let same = self.shown.get(i).is_some_and(|s| *s == indices[i]);
                buffer.push(if same { AS_BEFORE } else { indices[i] });
            }
        }
        let frame = gif::Frame {
            delay,
            dispose: gif::DisposalMethod::Keep,
            transparent: Some(AS_BEFORE),
            left: x0 as u16,
            top: y0 as u16,
            width: (x1 - x0 + 1) as u16,
            height: (y1 - y0 + 1) as u16,
            palette: Some(padded(&palette.rgb)),
            buffer: buffer.into(),
            ..gif::Frame::default()
        };
        self.encoder.write_frame(&frame).map_err(fail("gif"))?;
        self.shown = indices;
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<Vec<u8>, Error> {
        self.encoder.into_inner().map_err(fail("gif"))
    }
}

/// A table of 256 entries; the last is the transparent one.
fn padded(rgb: &[u8]) -> Vec<u8> {
    let mut out = rgb.to_vec();
    out.resize(3 * 256, 0);
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::FilmFormat;
    use crate::encode::tests::film;

    #[test]
    fn frames_time_and_colours_come_back() {
        let frames = film(9, 60, 40);
        let config = Film { format: FilmFormat::Gif, fps: 30, width: 60, height: 40, frames: 9 };
        let mut g = Box::new(Gif::new(&config).unwrap());
        for p in &frames {
            g.push(p).unwrap();
        }
        let bytes = g.finish().unwrap();
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::RGBA);
        let mut reader = options.read_info(std::io::Cursor::new(bytes)).unwrap();
        let mut canvas = vec![0_u8; 60 * 40 * 4];
        let (mut count, mut time) = (0, 0);
        while let Some(f) = reader.read_next_frame().unwrap() {
            for (i, p) in f.buffer.chunks_exact(4).enumerate() {
                if p[3] > 0 {
                    let (x, y) = (i % f.width as usize, i / f.width as usize);
                    let at = 4 * ((f.top as usize + y) * 60 + f.left as usize + x);
                    canvas[at..at + 4].copy_from_slice(p);
                }
            }
            let mean: f64 = canvas
                .iter()
                .zip(&frames[count].rgba)
                .map(|(a, b)| (f64::from(*a) - f64::from(*b)).abs())
                .sum::<f64>()
                / canvas.len() as f64;
            assert!(mean < 6.0, "frame {count}: mean error {mean}");
            count += 1;
            time += u32::from(f.delay);
        }
        assert_eq!((count, time), (9, 30), "9 frames of 1/30 s are 30 hundredths");
    }
}
