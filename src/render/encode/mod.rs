//! Files of pictures: stills (PNG, JPEG) and films (MP4, GIF, APNG).
//!
//! A [`VideoWriter`] encodes on its own thread, so that the renderer draws the next frame
//! meanwhile. The channel between them is short, to bound memory.
//!
//! Rejected: WebP. The pure-Rust encoder writes only lossless stills, and the other one binds a C
//! library that no other part needs. APNG and MP4 replace animated WebP.

mod apng;
mod film;
mod gif;
mod mp4;
mod stream;
mod video;

pub use film::{Film, FilmFormat};
pub use stream::FilmStream;
pub use video::{VideoWriter, Written};

use std::path::Path;

use super::{Error, Picture};

/// Supported suffixes.
pub const ENDINGS: &str = ".png, .jpg, .mp4, .gif or .apng";
/// JPEG quality of stills: about 30 kB at 640x480.
pub const JPEG_QUALITY: u8 = 88;

fn fail<E: std::fmt::Display>(format: &'static str) -> impl Fn(E) -> Error {
    move |e| Error::Encode { format, reason: e.to_string() }
}

/// A PNG without opacity.
///
/// # Errors
/// [`Error::Encode`].
pub fn png(picture: &Picture) -> Result<Vec<u8>, Error> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, picture.width, picture.height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Balanced);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    let mut writer = encoder.write_header().map_err(fail("png"))?;
    writer.write_image_data(&picture.to_rgb()).map_err(fail("png"))?;
    writer.finish().map_err(fail("png"))?;
    Ok(out)
}

/// A JPEG; `quality` 1 to 100. Full colour resolution: thin coloured lines stay clean.
///
/// # Errors
/// [`Error::Encode`], [`Error::Size`] beyond 65535 pixels an edge.
pub fn jpeg(picture: &Picture, quality: u8) -> Result<Vec<u8>, Error> {
    let (Ok(width), Ok(height)) = (u16::try_from(picture.width), u16::try_from(picture.height))
    else {
        return Err(Error::Size {
            width: picture.width,
            height: picture.height,
            max_px: u32::from(u16::MAX),
        });
    };
    let mut out = Vec::new();
    let mut encoder = jpeg_encoder::Encoder::new(&mut out, quality.clamp(1, 100));
    let factor = if quality >= 85 {
        jpeg_encoder::SamplingFactor::R_4_4_4
    } else {
        jpeg_encoder::SamplingFactor::R_4_2_0
    };
    encoder.set_sampling_factor(factor);
    encoder
        .encode(&picture.rgba, width, height, jpeg_encoder::ColorType::Rgba)
        .map_err(fail("jpeg"))?;
    Ok(out)
}

/// Writes one picture; the suffix of `path` (png, jpg) decides the format.
///
/// # Errors
/// [`Error::Format`], [`Error::Encode`], [`Error::File`].
pub fn save(picture: &Picture, path: &Path) -> Result<(), Error> {
    let bytes = match ending(path).as_str() {
        "png" => png(picture)?,
        "jpg" | "jpeg" => jpeg(picture, JPEG_QUALITY)?,
        _ => return Err(Error::Format { known: ".png or .jpg", path: path.to_owned() }),
    };
    Ok(robert_base::fsio::write_atomic(path, &bytes)?)
}

/// The suffix of a path in lower case, without the dot.
pub fn ending(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}

/// The smallest rectangle `[x, y, width, height]` outside which both pictures agree; none if
/// they are equal.
fn changed(a: &Picture, b: &Picture) -> Option<[u32; 4]> {
    let row = a.width as usize * 4;
    let differs = |y: &usize| a.rgba[y * row..(y + 1) * row] != b.rgba[y * row..(y + 1) * row];
    let top = (0..a.height as usize).find(differs)?;
    let bottom = (0..a.height as usize).rev().find(differs)?;
    let (mut left, mut right) = (a.width, 0);
    for y in top..=bottom {
        let pair = a.rgba[y * row..(y + 1) * row]
            .chunks_exact(4)
            .zip(b.rgba[y * row..(y + 1) * row].chunks_exact(4));
        for (x, (p, q)) in pair.enumerate() {
            if p != q {
                left = left.min(x as u32);
                right = right.max(x as u32);
            }
        }
    }
    Some([left, top as u32, right - left + 1, (bottom - top) as u32 + 1])
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A square that walks over a gradient.
    pub(crate) fn film(frames: u32, width: u32, height: u32) -> Vec<Picture> {
        (0..frames)
            .map(|f| {
                let mut p = Picture::filled(width, height, [0; 3]);
                for y in 0..height {
                    for x in 0..width {
                        let at = 4 * (y * width + x) as usize;
                        let inside =
                            (x as i32 - 3 * f as i32 - 4).abs() < 4 && (y as i32 - 8).abs() < 4;
                        let rgb =
                            if inside { [230, 60, 20] } else { [(x * 2) as u8, 90, (y * 3) as u8] };
                        p.rgba[at..at + 3].copy_from_slice(&rgb);
                    }
                }
                p
            })
            .collect()
    }

    #[test]
    fn png_comes_back_bit_for_bit() {
        let p = &film(1, 37, 21)[0];
        let bytes = png(p).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut out = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut out).unwrap();
        assert_eq!((info.width, info.height), (37, 21));
        assert_eq!(out, p.to_rgb());
    }

    #[test]
    fn jpeg_has_its_size() {
        let bytes = jpeg(&film(1, 64, 48)[0], JPEG_QUALITY).unwrap();
        assert_eq!(&bytes[..3], &[0xff, 0xd8, 0xff]);
        let sof = bytes.windows(2).position(|w| w == [0xff, 0xc0]).unwrap();
        assert_eq!(&bytes[sof + 5..sof + 9], &[0, 48, 0, 64]);
    }

    #[test]
    fn the_changed_rectangle_is_tight() {
        let a = Picture::filled(10, 8, [5; 3]);
        let mut b = a.clone();
        assert_eq!(changed(&a, &b), None);
        b.rgba[4 * (2 * 10 + 3)] = 9;
        b.rgba[4 * (5 * 10 + 7) + 1] = 9;
        assert_eq!(changed(&a, &b), Some([3, 2, 5, 4]));
    }
}
