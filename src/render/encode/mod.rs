//! Files of pictures.

use std::path::Path;

use super::{Error, Picture};

fn fail(format: &'static str) -> impl Fn(&dyn std::fmt::Display) -> Error {
    move |e| Error::Encode { format, reason: e.to_string() }
}

/// A PNG without opacity.
///
/// # Errors
/// [`Error::Encode`].
pub fn png(picture: &Picture) -> Result<Vec<u8>, Error> {
    let fail = fail("png");
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, picture.width, picture.height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    let mut writer = encoder.write_header().map_err(|e| fail(&e))?;
    writer.write_image_data(&picture.to_rgb()).map_err(|e| fail(&e))?;
    writer.finish().map_err(|e| fail(&e))?;
    Ok(out)
}

/// Writes one picture in the format that the ending of `path` names (png, jpg).
///
/// # Errors
/// [`Error::Format`], [`Error::Encode`], [`Error::File`].
pub fn save(picture: &Picture, path: &Path) -> Result<(), Error> {
    Ok(crate::fsio::write_atomic(path, &png(picture)?)?)
}
