//! An open device: buffers, submissions, and its errors.

use std::sync::{Arc, Mutex, PoisonError};

use super::adapter::{Arithmetic, Card};
use super::trusted;
use super::units::{MATRICES, Units, units};
use super::{Error, adapter};

/// The memory and binding sizes of a card that a training step may use.
#[derive(Clone, Copy, Debug)]
pub struct Room {
    /// The most bytes of one buffer that a kernel sees.
    pub binding_bytes: u64,
    /// Bytes for the activations of the windows that are computed at once.
    pub activation_bytes: u64,
}

/// An open device.
#[derive(Debug)]
pub struct Device {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    name: String,
    room: Room,
    /// The units that multiply, if matrices are multiplied in 16 bits.
    units: Option<Units>,
    /// The first thing that went wrong, in the driver's words.
    fault: Arc<Mutex<Option<String>>>,
}

/// A part of a buffer, as a kernel sees it.
#[derive(Clone, Debug)]
pub(crate) struct Span {
    pub(crate) buffer: wgpu::Buffer,
    pub(crate) offset: u64,
    pub(crate) bytes: u64,
}

impl Device {
    /// Opens the card of this number, or the first; see [`adapter::cards`].
    ///
    /// # Errors
    /// [`Error::Absent`], [`Error::Number`], and those of [`Device::of`].
    pub fn open(
        number: Option<usize>,
        software: bool,
        arithmetic: Arithmetic,
    ) -> Result<Self, Error> {
        Self::of(&adapter::choose(number, software)?, arithmetic)
    }

    /// Opens this card.
    ///
    /// # Errors
    /// [`Error::Broken`], [`Error::Unfit`]; [`Error::Half`] if the card has no units for matrices of
    /// 16-bit factors and these are wanted.
    pub fn of(card: &Card, arithmetic: Arithmetic) -> Result<Self, Error> {
        let broken = |why: String| Error::Broken { device: card.name.clone(), why };
        let limits = card.adapter.limits();
        if limits.max_compute_invocations_per_workgroup < 256
            || limits.max_compute_workgroup_storage_size < 16_384
        {
            let why = "it has fewer than 256 threads or 16 KiB in a workgroup".to_owned();
            return Err(Error::Unfit { device: card.name.clone(), why });
        }
        let units = match arithmetic {
            Arithmetic::Single => None,
            Arithmetic::Half => Some(units(card)?),
        };
        let room = Room {
            binding_bytes: limits.max_storage_buffer_binding_size.min(limits.max_buffer_size),
            activation_bytes: card.activation_bytes,
        };
        let description = wgpu::DeviceDescriptor {
            label: Some("robert training"),
            required_limits: limits,
            required_features: if units.is_some() { MATRICES } else { wgpu::Features::empty() },
            experimental_features: units.map(|_| trusted::matrices()).unwrap_or_default(),
            memory_hints: wgpu::MemoryHints::MemoryUsage,
            ..wgpu::DeviceDescriptor::default()
        };
        let (device, queue) = pollster::block_on(card.adapter.request_device(&description))
            .map_err(|e| broken(e.to_string()))?;
        let fault = Arc::new(Mutex::new(None));
        let note = |slot: &Arc<Mutex<Option<String>>>| {
            let slot = Arc::clone(slot);
            move |why: String| {
                // The driver's words fill several lines.
                let why = why.split_whitespace().collect::<Vec<_>>().join(" ");
                slot.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(why);
            }
        };
        // Without a handler wgpu panics.
        let noted = note(&fault);
        device.on_uncaptured_error(Arc::new(move |e: wgpu::Error| noted(e.to_string())));
        let noted = note(&fault);
        device.set_device_lost_callback(move |_, why| noted(format!("device lost: {why}")));
        Ok(Device { device, queue, name: card.name.clone(), room, units, fault })
    }

    /// The card's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The memory and binding sizes that a training step may use.
    pub fn room(&self) -> Room {
        self.room
    }

    /// The units that multiply, if matrices are multiplied in 16 bits.
    pub(crate) fn units(&self) -> Option<Units> {
        self.units
    }

    /// Uses less of it.
    #[must_use]
    pub fn within(mut self, room: Room) -> Self {
        self.room.binding_bytes = self.room.binding_bytes.min(room.binding_bytes);
        self.room.activation_bytes = self.room.activation_bytes.min(room.activation_bytes);
        self
    }

    /// Ends the device, as a driver does that resets its card.
    #[doc(hidden)]
    pub fn lose(&self) {
        self.device.destroy();
    }

    /// The first thing that went wrong, if anything did.
    pub(crate) fn fault(&self) -> Option<String> {
        self.fault.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// What `make` allocates, or nothing if the card's memory does not suffice.
    ///
    /// # Errors
    /// Other faults, in the driver's words.
    pub(crate) fn allocate<T>(&self, make: impl FnOnce() -> T) -> Result<Option<T>, String> {
        let memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        // A buffer that was not allocated cannot be bound, which is an error of its own.
        let use_of_it = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let made = make();
        let misused = pollster::block_on(use_of_it.pop());
        let full = pollster::block_on(memory.pop()).is_some();
        match (full, misused, self.fault()) {
            (_, _, Some(why)) => Err(why),
            (true, ..) => Ok(None),
            (false, Some(why), _) => Err(why.to_string()),
            (false, None, None) => Ok(Some(made)),
        }
    }

    /// A buffer of zeros that kernels read and write.
    pub(crate) fn buffer(&self, bytes: u64) -> Span {
        let bytes = bytes.next_multiple_of(16).max(16);
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: bytes,
            usage: wgpu::BufferUsages::STORAGE
                | wgpu::BufferUsages::COPY_SRC
                | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        Span { buffer, offset: 0, bytes }
    }

    /// A buffer of `n` factors of products.
    pub(crate) fn factors(&self, n: usize) -> Span {
        self.buffer(self.factor_bytes() * n as u64)
    }

    /// Bytes of a factor of a product.
    pub(crate) fn factor_bytes(&self) -> u64 {
        if self.units.is_some() { 2 } else { 4 }
    }

    /// A buffer of the parameters of a dispatch.
    pub(crate) fn uniform(&self, words: &[u32]) -> wgpu::Buffer {
        let bytes: &[u8] = bytemuck::cast_slice(words);
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: (bytes.len() as u64).next_multiple_of(16),
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        self.queue.write_buffer(&buffer, 0, bytes);
        buffer
    }

    pub(crate) fn write<T: bytemuck::Pod>(&self, to: &Span, data: &[T]) {
        if !data.is_empty() {
            self.queue.write_buffer(&to.buffer, to.offset, bytemuck::cast_slice(data));
        }
    }

    /// Reads these buffers when everything that was submitted so far is done. `meanwhile` runs
    /// while the card computes.
    ///
    /// # Errors
    /// The driver's words when the device is lost.
    pub(crate) fn read<T: bytemuck::Pod>(
        &self,
        from: &[&Span],
        meanwhile: impl FnOnce(),
    ) -> Result<Vec<Vec<T>>, String> {
        let mut encoder =
            self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let copies: Vec<_> = from
            .iter()
            .map(|span| {
                let copy = self.device.create_buffer(&wgpu::BufferDescriptor {
                    label: None,
                    size: span.bytes,
                    usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
                    mapped_at_creation: false,
                });
                encoder.copy_buffer_to_buffer(&span.buffer, span.offset, &copy, 0, span.bytes);
                copy
            })
            .collect();
        self.queue.submit([encoder.finish()]);
        let failed = Arc::new(Mutex::new(None));
        for copy in &copies {
            let failed = Arc::clone(&failed);
            copy.map_async(wgpu::MapMode::Read, .., move |done| {
                if let Err(e) = done {
                    *failed.lock().unwrap_or_else(PoisonError::into_inner) = Some(e.to_string());
                }
            });
        }
        meanwhile();
        let polled = self.device.poll(wgpu::PollType::wait_indefinitely());
        if let Some(why) = self.fault() {
            return Err(why);
        }
        polled.map_err(|e| e.to_string())?;
        if let Some(why) = failed.lock().unwrap_or_else(PoisonError::into_inner).take() {
            return Err(why);
        }
        copies
            .iter()
            .map(|copy| {
                let view = copy.get_mapped_range(..).map_err(|e| e.to_string())?;
                Ok(bytemuck::pod_collect_to_vec(&view))
            })
            .collect()
    }
}

impl Span {
    /// A part of it, in bytes; the offset is a multiple of 256.
    pub(crate) fn part(&self, offset: u64, bytes: u64) -> Span {
        assert!(offset + bytes <= self.bytes && offset.is_multiple_of(256), "a part outside");
        Span { buffer: self.buffer.clone(), offset: self.offset + offset, bytes }
    }
}
