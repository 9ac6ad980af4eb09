//! H.264 in MP4, with the index first so that a browser can start at once.
//!
//! Encoder: `OpenH264`, built from source (BSD-2). Muxer: `shiguredo_mp4`, which does no I/O of
//! its own and also parses the encoder's parameter sets. Rejected: muxide (mainly a recording
//! application), mp4 (no release for years), mp4-atom (boxes only; we would have to maintain the
//! sample tables).

use std::num::NonZeroU32;

use openh264::OpenH264API;
use openh264::encoder::{
    Encoder, EncoderConfig, FrameRate, FrameType, IntraFramePeriod, QpRange, RateControlMode,
    UsageType, VuiConfig,
};
use openh264::formats::YUVSlices;
use shiguredo_mp4::TrackKind;

use shiguredo_mp4::bitstream::h264::{
    H264SampleEntryConfig, LengthSize, annexb_to_length_prefixed, build_avc1_box_from_annexb,
};
use shiguredo_mp4::boxes::SampleEntry;
use shiguredo_mp4::mux::{
    Mp4FileMuxer, Mp4FileMuxerOptions, Sample, estimate_maximum_moov_box_size,
};

use super::fail;
use super::film::{Encode, Film};
use crate::{Error, Picture};

/// Quantiser: no visible artefacts on these pictures at 2 kB per frame.
const QP: u8 = 23;
/// Frames between points that a player can jump to.
const KEY_EVERY: u32 = 40;
/// Limits of the encoder, pixels: least edge, longer edge, shorter edge (level 5.1).
const LEAST: u32 = 16;
const LONG: u32 = 3840;
const SHORT: u32 = 2160;

pub(super) struct Mp4 {
    encoder: Encoder,
    muxer: Mp4FileMuxer,
    out: Vec<u8>,
    fps: NonZeroU32,
    planes: Planes,
    first: bool,
}

/// Luma and quartered chroma, BT.709, limited range.
struct Planes {
    width: usize,
    height: usize,
    y: Vec<u8>,
    u: Vec<u8>,
    v: Vec<u8>,
}

/// Refuses sizes that the encoder does not support.
pub(super) fn check_size(width: u32, height: u32) -> Result<(), Error> {
    let (short, long) = (width.min(height), width.max(height));
    if (LEAST..=SHORT).contains(&short) && long <= LONG {
        return Ok(());
    }
    Err(Error::FilmSize { width, height, least: LEAST, long: LONG, short: SHORT })
}

impl Mp4 {
    pub(super) fn new(film: &Film) -> Result<Mp4, Error> {
        let fps = film.fps.max(1);
        let config = EncoderConfig::new()
            .usage_type(UsageType::CameraVideoRealTime)
            .rate_control_mode(RateControlMode::Off)
            .qp(QpRange::new(QP, QP))
            .max_frame_rate(FrameRate::from_hz(fps as f32))
            .intra_frame_period(IntraFramePeriod::from_num_frames(KEY_EVERY))
            .skip_frames(false)
            .num_threads(1)
            .vui(VuiConfig::bt709());
        let encoder =
            Encoder::with_api_config(OpenH264API::from_source(), config).map_err(fail("mp4"))?;
        let options = Mp4FileMuxerOptions {
            reserved_moov_box_size: estimate_maximum_moov_box_size(&[film.frames as usize]),
            ..Mp4FileMuxerOptions::default()
        };
        let muxer = Mp4FileMuxer::with_options(options).map_err(fail("mp4"))?;
        let out = muxer.initial_boxes_bytes().to_vec();
        let fps = NonZeroU32::new(fps).unwrap_or(NonZeroU32::MIN);
        let planes = Planes::new(film.width as usize, film.height as usize);
        Ok(Mp4 { encoder, muxer, out, fps, planes, first: true })
    }
}

impl Encode for Mp4 {
    fn push(&mut self, picture: &Picture) -> Result<(), Error> {
        self.planes.fill(picture);
        let p = &self.planes;
        let yuv = YUVSlices::new(
            (&p.y, &p.u, &p.v),
            (p.width, p.height),
            (p.width, p.width / 2, p.width / 2),
        );
        let stream = self.encoder.encode(&yuv).map_err(fail("mp4"))?;
        let keyframe = matches!(stream.frame_type(), FrameType::IDR | FrameType::I);
        let annex_b = stream.to_vec();
        if annex_b.is_empty() {
            let reason = "the encoder left out a frame".to_owned();
            return Err(Error::Encode { format: "mp4", reason });
        }
        let length = LengthSize::FourBytes;
        let sample_entry = if self.first {
            let config = H264SampleEntryConfig { length_size: length };
            let avc1 = build_avc1_box_from_annexb(&annex_b, &config).map_err(fail("mp4"))?;
            Some(SampleEntry::Avc1(avc1))
        } else {
            None
        };
        self.first = false;
        let bytes = annexb_to_length_prefixed(&annex_b, length).map_err(fail("mp4"))?;
        let sample = Sample {
            track_kind: TrackKind::Video,
            sample_entry,
            keyframe,
            timescale: self.fps,
            duration: 1,
            composition_time_offset: None,
            data_offset: self.out.len() as u64,
            data_size: bytes.len(),
        };
        self.out.extend_from_slice(&bytes);
        self.muxer.append_sample(&sample).map_err(fail("mp4"))
    }

    fn finish(mut self: Box<Self>) -> Result<Vec<u8>, Error> {
        let parts = self.muxer.finalize().map_err(fail("mp4"))?;
        for (offset, bytes) in parts.offset_and_bytes_pairs() {
            let from = offset as usize;
            let end = from + bytes.len();
            if self.out.len() < end {
                self.out.resize(end, 0);
            }
            self.out[from..end].copy_from_slice(bytes);
        }
        Ok(std::mem::take(&mut self.out))
    }
}

impl Planes {
    /// Even edges: an odd picture is widened by its last column or row.
    fn new(width: usize, height: usize) -> Planes {
        let (width, height) = (width.next_multiple_of(2), height.next_multiple_of(2));
        let quarter = width * height / 4;
        Planes {
            width,
            height,
            y: vec![0; width * height],
            u: vec![0; quarter],
            v: vec![0; quarter],
        }
    }

    fn fill(&mut self, picture: &Picture) {
        let pitch = 4 * picture.width as usize;
        let last = picture.height as usize - 1;
        let edge = picture.width as usize - 1;
        for pair in 0..self.height / 2 {
            let row = |r: usize| &picture.rgba[r.min(last) * pitch..(r.min(last) + 1) * pitch];
            let rows = [row(2 * pair), row(2 * pair + 1)];
            for column in 0..self.width / 2 {
                let mut sum = [0_i32; 3];
                for (dy, row) in rows.iter().enumerate() {
                    for dx in 0..2 {
                        let at = 4 * (2 * column + dx).min(edge);
                        let [r, g, b] = [row[at], row[at + 1], row[at + 2]].map(i32::from);
                        // 16.16 fixed point: 219/255 of the BT.709 weights.
                        let y =
                            (11_966 * r + 40_254 * g + 4_064 * b + (16 << 16) + (1 << 15)) >> 16;
                        self.y[(2 * pair + dy) * self.width + 2 * column + dx] = y as u8;
                        sum = [sum[0] + r, sum[1] + g, sum[2] + b];
                    }
                }
                let [r, g, b] = sum;
                // Four pixels are summed, hence two more bits.
                let chroma = |x: i32| ((x + (128 << 18) + (1 << 17)) >> 18) as u8;
                let at = pair * self.width / 2 + column;
                self.u[at] = chroma(-6_596 * r - 22_189 * g + 28_785 * b);
                self.v[at] = chroma(28_785 * r - 26_145 * g - 2_640 * b);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::FilmFormat;
    use crate::encode::tests::film;
    use openh264::decoder::Decoder;
    use openh264::formats::YUVSource;

    #[test]
    fn colours_are_bt709() {
        for (rgb, y, u, v) in [
            ([255, 255, 255], 235, 128, 128),
            ([0, 0, 0], 16, 128, 128),
            ([255, 0, 0], 63, 102, 240),
            ([0, 0, 255], 32, 240, 118),
        ] {
            let mut p = Planes::new(2, 2);
            p.fill(&Picture::filled(2, 2, rgb));
            let near = |a: u8, b: u8| a.abs_diff(b) <= 1;
            assert!(
                near(p.y[0], y) && near(p.u[0], u) && near(p.v[0], v),
                "{rgb:?} {:?}",
                (p.y[0], p.u[0], p.v[0])
            );
        }
    }

    /// Reads the file back: boxes by the muxer's own reader, pictures by the decoder.
    #[test]
    fn a_film_can_be_demuxed_and_decoded() {
        use shiguredo_mp4::demux::{Input, Mp4FileDemuxer};
        let frames = film(45, 64, 48);
        let config = Film { format: FilmFormat::Mp4, fps: 20, width: 64, height: 48, frames: 45 };
        let mut mp4 = Box::new(Mp4::new(&config).unwrap());
        for p in &frames {
            mp4.push(p).unwrap();
        }
        let bytes = mp4.finish().unwrap();
        let at = |name: &[u8]| bytes.windows(4).position(|w| w == name).unwrap();
        assert!(at(b"moov") < at(b"mdat"), "index behind the data");

        let mut demuxer = Mp4FileDemuxer::new();
        while let Some(need) = demuxer.required_input() {
            let from = need.position as usize;
            let end = need.size.map_or(bytes.len(), |s| (from + s).min(bytes.len()));
            demuxer.handle_input(Input { position: need.position, data: &bytes[from..end] });
        }
        let mut decoder = Decoder::new().unwrap();
        let mut count = 0;
        while let Some(sample) = demuxer.next_sample().unwrap() {
            let from = sample.data_offset as usize;
            let data = &bytes[from..from + sample.data_size];
            let annex_b = shiguredo_mp4::bitstream::h264::length_prefixed_to_annexb(
                data,
                LengthSize::FourBytes,
            )
            .unwrap();
            let image = decoder.decode(&annex_b).unwrap().expect("a frame a sample");
            assert_eq!(image.dimensions(), (64, 48));
            let mut planes = Planes::new(64, 48);
            planes.fill(&frames[count]);
            let (stride, _, _) = image.strides();
            let mut off = 0.0;
            for y in 0..48 {
                for x in 0..64 {
                    off += f64::from(image.y()[y * stride + x].abs_diff(planes.y[y * 64 + x]));
                }
            }
            assert!(off / (64.0 * 48.0) < 6.0, "frame {count}: {off}");
            assert_eq!(sample.keyframe, count % KEY_EVERY as usize == 0);
            count += 1;
        }
        assert_eq!(count, 45);
    }
}
