//! APNG: lossless; each frame contains only the changed rectangle.

use super::film::{Encode, Film};
use super::{changed, fail};
use crate::{Error, Picture};

pub(super) struct Apng {
    writer: Option<png::Writer<Sink>>,
    sink: Sink,
    last: Option<Picture>,
    left: u32,
}

/// The PNG writer wants to own its output; the bytes are taken out at the end.
#[derive(Clone, Default)]
struct Sink(std::sync::Arc<std::sync::Mutex<Vec<u8>>>);

impl std::io::Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let mut out = self.0.lock().map_err(|_poison| std::io::Error::other("poisoned"))?;
        out.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Apng {
    pub(super) fn new(film: &Film) -> Result<Apng, Error> {
        let sink = Sink::default();
        let mut encoder = png::Encoder::new(sink.clone(), film.width, film.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::Balanced);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        encoder.set_animated(film.frames.max(1), 0).map_err(fail("apng"))?;
        let fps = u16::try_from(film.fps.max(1)).map_err(fail("apng"))?;
        encoder.set_frame_delay(1, fps).map_err(fail("apng"))?;
        encoder.set_blend_op(png::BlendOp::Source).map_err(fail("apng"))?;
        encoder.set_dispose_op(png::DisposeOp::None).map_err(fail("apng"))?;
        let writer = encoder.write_header().map_err(fail("apng"))?;
        Ok(Apng { writer: Some(writer), sink, last: None, left: film.frames.max(1) })
    }
}

impl Encode for Apng {
    fn push(&mut self, picture: &Picture) -> Result<(), Error> {
        let Some(writer) = self.writer.as_mut() else { return Err(Error::NoFrames) };
        if self.left == 0 {
            let reason = "there are more frames than announced".to_owned();
            return Err(Error::Encode { format: "apng", reason });
        }
        // An unchanged frame still needs a pixel to carry its delay.
        let [x, y, w, h] = match &self.last {
            None => [0, 0, picture.width, picture.height],
            Some(last) => changed(last, picture).unwrap_or([0, 0, 1, 1]),
        };
        if self.last.is_some() {
            writer.reset_frame_position().map_err(fail("apng"))?;
            writer.set_frame_dimension(w, h).map_err(fail("apng"))?;
            writer.set_frame_position(x, y).map_err(fail("apng"))?;
        }
        let mut part = Vec::with_capacity(3 * w as usize * h as usize);
        for row in y..y + h {
            let from = 4 * (row as usize * picture.width as usize + x as usize);
            for p in picture.rgba[from..from + 4 * w as usize].chunks_exact(4) {
                part.extend_from_slice(&p[..3]);
            }
        }
        writer.write_image_data(&part).map_err(fail("apng"))?;
        self.left -= 1;
        self.last = Some(picture.clone());
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<Vec<u8>, Error> {
        if self.left > 0 {
            let reason = format!("{} of the announced frames are missing", self.left);
            return Err(Error::Encode { format: "apng", reason });
        }
        if let Some(writer) = self.writer.take() {
            writer.finish().map_err(fail("apng"))?;
        }
        let mut out = self.sink.0.lock().map_err(fail("apng"))?;
        Ok(std::mem::take(&mut *out))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::FilmFormat;
    use crate::encode::tests::film;

    #[test]
    fn every_frame_comes_back() {
        let frames = film(5, 40, 24);
        let config = Film { format: FilmFormat::Apng, fps: 20, width: 40, height: 24, frames: 5 };
        let mut apng = Box::new(Apng::new(&config).unwrap());
        for p in &frames {
            apng.push(p).unwrap();
        }
        let bytes = apng.finish().unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        assert_eq!(reader.info().animation_control().unwrap().num_frames, 5);
        let mut canvas = vec![0; 40 * 24 * 3];
        for p in &frames {
            let mut part = vec![0; reader.output_buffer_size().unwrap()];
            let info = reader.next_frame(&mut part).unwrap();
            let at = *reader.info().frame_control().unwrap();
            for row in 0..info.height as usize {
                let from = 3 * ((at.y_offset as usize + row) * 40 + at.x_offset as usize);
                let n = 3 * info.width as usize;
                canvas[from..from + n].copy_from_slice(&part[row * n..(row + 1) * n]);
            }
            assert_eq!(canvas, p.to_rgb());
        }
    }
}
