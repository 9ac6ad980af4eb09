//! A picture in memory, and combinations of pictures: side by side, film strip.

use super::Error;

/// 8-bit sRGB with opacity, rows from the top, no padding.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// `4 * width * height` bytes, R G B A.
    pub rgba: Vec<u8>,
}

/// Gap between two combined pictures.
const GAP_PX: u32 = 6;

impl Picture {
    /// One colour everywhere.
    pub fn filled(width: u32, height: u32, rgb: [u8; 3]) -> Picture {
        let pixel = [rgb[0], rgb[1], rgb[2], 255];
        let count = width as usize * height as usize;
        Picture { width, height, rgba: pixel.repeat(count) }
    }

    /// Red, green and blue at a pixel; black outside.
    pub fn rgb(&self, x: u32, y: u32) -> [u8; 3] {
        if x >= self.width {
            return [0; 3];
        }
        let at = 4 * (y as usize * self.width as usize + x as usize);
        self.rgba.get(at..at + 3).map_or([0; 3], |p| [p[0], p[1], p[2]])
    }

    /// The colours without the opacity, `3 * width * height` bytes.
    pub fn to_rgb(&self) -> Vec<u8> {
        let mut out = Vec::with_capacity(self.rgba.len() / 4 * 3);
        for p in self.rgba.chunks_exact(4) {
            out.extend_from_slice(&p[..3]);
        }
        out
    }

    /// Copies `other` onto this one with its corner at (x, y); parts outside are clipped.
    pub fn paste(&mut self, other: &Picture, x: u32, y: u32) {
        if x >= self.width {
            return;
        }
        let columns = other.width.min(self.width - x) as usize * 4;
        let rows = other.rgba.chunks_exact(other.width.max(1) as usize * 4);
        let pitch = self.width as usize * 4;
        for (target, row) in self.rgba.chunks_exact_mut(pitch).skip(y as usize).zip(rows) {
            let from = x as usize * 4;
            target[from..from + columns].copy_from_slice(&row[..columns]);
        }
    }

    /// Side by side with a thin gap, top edges level.
    ///
    /// # Errors
    /// [`Error::NoFrames`] without pictures.
    pub fn beside(pictures: &[Picture]) -> Result<Picture, Error> {
        let Some(first) = pictures.first() else { return Err(Error::NoFrames) };
        if pictures.len() == 1 {
            return Ok(first.clone());
        }
        let width =
            pictures.iter().map(|p| p.width).sum::<u32>() + GAP_PX * (pictures.len() as u32 - 1);
        let height = pictures.iter().map(|p| p.height).max().unwrap_or(0);
        let mut out = Picture::filled(width, height, [255; 3]);
        let mut x = 0;
        for p in pictures {
            out.paste(p, x, 0);
            x += p.width + GAP_PX;
        }
        Ok(out)
    }

    /// A film strip: moments in reading order, at most `columns` per row.
    ///
    /// # Errors
    /// [`Error::NoFrames`] without pictures.
    pub fn strip(pictures: &[Picture], columns: usize) -> Result<Picture, Error> {
        let Some(first) = pictures.first() else { return Err(Error::NoFrames) };
        let mut strip = Strip::new(pictures.len(), columns, (first.width, first.height));
        for (i, p) in pictures.iter().enumerate() {
            strip.put(i, p);
        }
        Ok(strip.finish())
    }

    /// Pixels of pictures of these widths and this height side by side.
    pub fn beside_px(width: u32, height: u32, count: u32) -> (u32, u32) {
        let gaps = GAP_PX.saturating_mul(count.saturating_sub(1));
        (width.saturating_mul(count).saturating_add(gaps), height)
    }
}

/// A film strip that is filled cell by cell, so that only the strip is in memory.
#[derive(Clone, Debug)]
pub struct Strip {
    picture: Picture,
    columns: usize,
    cell: (u32, u32),
}

impl Strip {
    /// A strip for `count` cells of `cell` pixels, at most `columns` per row.
    pub fn new(count: usize, columns: usize, cell: (u32, u32)) -> Strip {
        let columns = columns.clamp(1, count.max(1));
        let (width, height) = Strip::px(count, columns, cell);
        Strip { picture: Picture::filled(width, height, [255; 3]), columns, cell }
    }

    /// Pixels of such a strip.
    pub fn px(count: usize, columns: usize, (w, h): (u32, u32)) -> (u32, u32) {
        let columns = columns.clamp(1, count.max(1));
        let rows = count.div_ceil(columns).max(1) as u32;
        let along = |n: u32, px: u32| n.saturating_mul(px.saturating_add(GAP_PX)) - GAP_PX;
        (along(columns as u32, w), along(rows, h))
    }

    /// Fills the i-th cell in reading order.
    pub fn put(&mut self, i: usize, picture: &Picture) {
        let (column, row) = ((i % self.columns) as u32, (i / self.columns) as u32);
        let (w, h) = self.cell;
        self.picture.paste(picture, column * (w + GAP_PX), row * (h + GAP_PX));
    }

    /// The strip.
    pub fn finish(self) -> Picture {
        self.picture
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn put_together_keeps_every_pixel() {
        let red = Picture::filled(4, 3, [200, 0, 0]);
        let blue = Picture::filled(5, 2, [0, 0, 200]);
        let both = Picture::beside(&[red.clone(), blue.clone()]).unwrap();
        assert_eq!((both.width, both.height), (4 + GAP_PX + 5, 3));
        assert_eq!(both.rgb(3, 2), [200, 0, 0]);
        assert_eq!(both.rgb(4, 0), [255; 3], "gap");
        assert_eq!(both.rgb(4 + GAP_PX, 0), [0, 0, 200]);
        assert_eq!(both.rgb(4 + GAP_PX, 2), [255; 3], "below the lower one");
        let strip = Picture::strip(&[red.clone(), red.clone(), red], 2).unwrap();
        assert_eq!((strip.width, strip.height), (8 + GAP_PX, 6 + GAP_PX));
        assert_eq!(strip.rgb(0, 3 + GAP_PX), [200, 0, 0]);
        assert_eq!(strip.rgb(7 + GAP_PX, 5 + GAP_PX), [255; 3], "empty place");
        assert!(Picture::strip(&[], 3).is_err());
        assert_eq!(Strip::px(3, 2, (4, 3)), (strip.width, strip.height));
        assert_eq!(Strip::px(64, 6, (u32::MAX, 8192)).0, u32::MAX - GAP_PX, "no overflow");
        assert_eq!(Picture::beside_px(1920, 1080, 2), (3846, 1080));
        assert_eq!(Picture::beside_px(1920, 1080, 1), (1920, 1080));
    }
}
