//! Training on a card, behind the interface of the processor.

use super::adam::{Adam, State, Update};
use super::adapter::{Arithmetic, Choice, Request, software_wanted};
use super::device::{Device, Span};
use super::host::{Filler, Host};
use super::kernel::Tape;
use super::plan::{Kernels, Plan, Segments, parts, per_window};
use super::slots::Slots;
use super::squares::{PIECE, Squares};
use super::{Error, Room};
use robert_base::progress::Progress;
use robert_net::checkpoint::OptimiserState;
use robert_net::engine::{DeviceUse, Engine, Engines, Fill, average_share};
use robert_net::head::Sums;
use robert_net::step::GradientView;
use robert_net::{CpuEngine, Net, NetConfig, Setup, WINDOW};

/// With 16-bit factors a row's gradient is this many times the gradient of its own loss, until one
/// overflows.
const ABOVE: f32 = 16.0;

/// The most windows at once, by the most workgroups of a dispatch.
const WINDOWS: usize = 1024;

/// Weights, moments and activations on a card.
#[derive(Debug)]
pub struct GpuEngine {
    gpu: Device,
    /// The network without weights.
    net: Net<f32>,
    adam: robert_net::AdamConfig,
    batch: usize,
    slots: Slots,
    weights: Segments,
    grads: Segments,
    first: Segments,
    second: Segments,
    average: Option<Segments>,
    count: u64,
    plan: Plan,
    squares: Tape,
    pieces: Span,
    update: Tape,
    /// Parameters of the update of each segment.
    params: Vec<wgpu::Buffer>,
    filler: Filler,
    host: Host,
    /// The next batch, filled while the card computes.
    ahead: Host,
    bytes: u64,
}

impl GpuEngine {
    /// Allocates everything on the card: as many windows at once as fit.
    ///
    /// # Errors
    /// [`Error::Unfit`], [`Error::Memory`], [`Error::Broken`].
    pub fn new(gpu: Device, setup: &Setup) -> Result<Self, Error> {
        let cfg = &setup.net.cfg;
        let unfit = |why| Error::Unfit { device: gpu.name().to_owned(), why };
        let Room { binding_bytes, activation_bytes } = gpu.room();
        let most = usize::try_from(binding_bytes / 4).unwrap_or(usize::MAX);
        let slots = Slots::new(&setup.net.layout, most).map_err(unfit)?;
        let (window, largest) = per_window(cfg, gpu.factor_bytes());
        let room = activation_bytes / window;
        let fit = (room as usize).min(most / largest).min(WINDOWS);
        if most / largest == 0 || parts(&gpu, cfg, 1, most) > most {
            let why = format!("a kernel sees {binding_bytes} bytes of a buffer");
            return Err(Error::Unfit { device: gpu.name().to_owned(), why });
        }
        let mut windows = even(setup.batch, fit.max(1));
        let kernels = Kernels::new(&gpu);
        loop {
            let make = || Allocated::new(&gpu, &kernels, setup, &slots, windows, most);
            let made = gpu.allocate(make).map_err(|why| {
                let device = gpu.name().to_owned();
                Error::Broken { device, why }
            })?;
            if let Some(parts) = made {
                return Ok(Self::of(gpu, setup, slots, parts));
            }
            if windows == 1 {
                let needs = weights_bytes(&gpu, &slots, 5) + window;
                let device = gpu.name().to_owned();
                return Err(Error::Memory { device, needs_mib: needs.div_ceil(1 << 20) });
            }
            windows = even(setup.batch, windows / 2);
        }
    }

    fn of(gpu: Device, setup: &Setup, slots: Slots, allocated: Allocated) -> Self {
        let Setup { net, adam, batch, threads, current_only, .. } = setup;
        let Allocated { weights, grads, first, second, average, plan, squares, pieces, .. } =
            allocated;
        let filler = Filler::new(&net.cfg, &net.centres, *batch, *threads, *current_only);
        let sets = 4 + u64::from(average.is_some());
        let window = per_window(&net.cfg, gpu.factor_bytes()).0;
        let bytes = weights_bytes(&gpu, &slots, sets) + window * plan.windows as u64;
        let engine = GpuEngine {
            adam: *adam,
            batch: *batch,
            slots,
            weights,
            grads,
            first,
            second,
            average,
            count: 0,
            plan,
            squares,
            pieces,
            update: allocated.update,
            params: allocated.params,
            host: filler.host(),
            ahead: filler.host(),
            filler,
            bytes,
            net: Net {
                cfg: net.cfg.clone(),
                layout: net.layout.clone(),
                weights: robert_linalg::Aligned::zeros(0),
                centres: net.centres.clone(),
            },
            gpu,
        };
        engine.load(&engine.weights, &net.weights);
        if let Some(average) = &engine.average {
            engine.load(average, &net.weights);
        }
        engine
    }

    fn cfg(&self) -> &NetConfig {
        &self.net.cfg
    }

    fn load(&self, to: &Segments, flat: &[f32]) {
        for (span, numbers) in to.iter().zip(self.slots.spread(flat)) {
            self.gpu.write(span, &numbers);
        }
    }

    fn fetch(&self, from: &Segments) -> Result<Vec<f32>, robert_net::Error> {
        // One segment at a time, so that the processor needs no second copy of all.
        let mut all = Vec::with_capacity(from.len());
        for span in from {
            all.append(&mut self.gpu.read(&[span], || ()).map_err(|why| self.lost(why))?);
        }
        Ok(self.slots.gather(&all))
    }

    fn lost(&self, why: String) -> robert_net::Error {
        robert_net::Error::Lost { device: self.gpu.name().to_owned(), why }
    }

    /// Makes `self.host` batch `index` of the training.
    fn prepare(&mut self, fill: &Fill<'_>, index: u64) {
        if self.ahead.index == Some(index) {
            std::mem::swap(&mut self.host, &mut self.ahead);
        } else {
            self.filler.fill(&mut self.host, fill, index);
        }
        self.ahead.index = None;
    }

    /// Sends windows `from..` of the batch to the card, as many as the plan has. If the batch has
    /// fewer, the others have no weight.
    fn upload(&self, from: usize) {
        let (plan, host, a) = (&self.plan, &self.host, self.cfg().actions);
        let count = plan.windows.min(self.batch - from);
        let rows = from * WINDOW..(from + count) * WINDOW;
        let stride = self.filler.stride();
        self.gpu.write(&plan.tokens, &host.tokens[rows.start * stride..rows.end * stride]);
        self.gpu.write(&plan.actions, &host.actions[rows.start * a..rows.end * a]);
        if !host.linear.is_empty() {
            self.gpu.write(&plan.linear, &host.linear[rows.start * a..rows.end * a]);
        }
        let mut info = host.info[rows].to_vec();
        info.resize(plan.windows * WINDOW, [0; 4]);
        self.gpu.write(&plan.info, &info);
    }

    /// Runs the batch in pieces. After each piece it copies the buffers that `keep` names, and
    /// reads them at the end together with `also`. The first lists of the result are those of the
    /// pieces.
    fn pass<T: bytemuck::Pod>(
        &self,
        tapes: &[&Tape],
        keep: &Span,
        also: &[&Span],
        meanwhile: impl FnOnce(),
    ) -> Result<Vec<Vec<T>>, robert_net::Error> {
        let mut kept = Vec::new();
        for from in (0..self.batch).step_by(self.plan.windows) {
            self.upload(from);
            tapes.iter().for_each(|tape| tape.submit(&self.gpu));
            if self.plan.windows < self.batch {
                let copy = self.gpu.buffer(keep.bytes);
                let mut encoder = self
                    .gpu
                    .device
                    .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
                let bytes = keep.bytes;
                encoder.copy_buffer_to_buffer(&keep.buffer, keep.offset, &copy.buffer, 0, bytes);
                self.gpu.queue.submit([encoder.finish()]);
                kept.push(copy);
            }
        }
        if kept.is_empty() {
            kept.push(keep.clone());
        }
        if !also.is_empty() {
            self.squares.submit(&self.gpu);
        }
        let all: Vec<&Span> = kept.iter().chain(also.iter().copied()).collect();
        self.gpu.read(&all, meanwhile).map_err(|why| self.lost(why))
    }

    /// Errors of each token of the batch, from the pieces.
    fn tokens<'a>(&self, pieces: impl Iterator<Item = &'a Vec<f32>>) -> Vec<[f32; 2]> {
        let mut all = Vec::with_capacity(self.batch * WINDOW);
        for piece in pieces {
            all.extend(piece.as_chunks::<2>().0.iter().take(self.plan.windows * WINDOW));
        }
        all.truncate(self.batch * WINDOW);
        all
    }

    /// Gradient of the last batch, laid out as the weights.
    #[doc(hidden)]
    pub fn last_gradient(&self) -> Result<Vec<f32>, robert_net::Error> {
        let all = self.fetch(&self.grads)?;
        Ok(all.into_iter().map(|x| x / self.plan.scale()).collect())
    }

    /// The card.
    pub fn gpu(&self) -> &Device {
        &self.gpu
    }
}

/// The buffers for one number of windows.
struct Allocated {
    weights: Segments,
    grads: Segments,
    first: Segments,
    second: Segments,
    average: Option<Segments>,
    plan: Plan,
    squares: Tape,
    pieces: Span,
    update: Tape,
    params: Vec<wgpu::Buffer>,
}

impl Allocated {
    fn new(
        gpu: &Device,
        kernels: &Kernels,
        setup: &Setup,
        slots: &Slots,
        windows: usize,
        most: usize,
    ) -> Self {
        let set =
            || -> Segments { slots.segments.iter().map(|&n| gpu.buffer(4 * n as u64)).collect() };
        let [weights, grads, first, second] = [set(), set(), set(), set()];
        let average = setup.averages.then(set);
        let tokens = if setup.current_only { 1 } else { WINDOW };
        let rows = (setup.batch * tokens).next_power_of_two();
        let scale = if gpu.units().is_some() { ABOVE * rows as f32 } else { 1.0 };
        let on = [&weights, &grads];
        let plan = Plan::new(gpu, kernels, &setup.net, slots, on, [windows, most], scale);

        let norm = Squares::new(gpu);
        let starts = slots.segments.iter().scan(0, |at, n| {
            *at += n.div_ceil(PIECE);
            Some(*at - n.div_ceil(PIECE))
        });
        let total: usize = slots.segments.iter().map(|n| n.div_ceil(PIECE)).sum();
        let pieces = gpu.buffer(4 * total as u64);
        let mut squares = Tape::default();
        for ((&n, grads), start) in slots.segments.iter().zip(&grads).zip(starts) {
            squares.push(norm.step(gpu, n, grads, &pieces, start));
        }

        let adam = Adam::new(gpu, setup.averages);
        let (mut update, mut params) = (Tape::default(), Vec::new());
        for (i, decays) in slots.decays().iter().enumerate() {
            let on = gpu.buffer(4 * decays.len() as u64);
            gpu.write(&on, decays);
            let unused = gpu.buffer(16);
            let state = State {
                decays: &on,
                grads: &grads[i],
                weights: &weights[i],
                first: &first[i],
                second: &second[i],
                average: average.as_ref().map_or(&unused, |a| &a[i]),
            };
            let words = gpu.uniform(&[0; 12]);
            update.push(adam.step(gpu, slots.segments[i], &words, state));
            params.push(words);
        }
        Allocated { weights, grads, first, second, average, plan, squares, pieces, update, params }
    }
}

/// Bytes of this many sets of numbers that are laid out as the weights, and of the weights as factors
/// of 16 bits if they are used.
fn weights_bytes(gpu: &Device, slots: &Slots, sets: u64) -> u64 {
    let copy = if gpu.units().is_some() { gpu.factor_bytes() } else { 0 };
    (4 * sets + copy) * slots.segments.iter().sum::<usize>() as u64
}

/// Windows at once, at most `most`, so that the pieces of a batch are nearly equal.
fn even(batch: usize, most: usize) -> usize {
    batch.div_ceil(batch.div_ceil(most.max(1)))
}

impl Engine for GpuEngine {
    fn gradient(
        &mut self,
        fill: &Fill<'_>,
        index: u64,
        next: Option<u64>,
    ) -> Result<GradientView, robert_net::Error> {
        self.prepare(fill, index);
        let mut clear =
            self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        for grads in &self.grads {
            clear.clear_buffer(&grads.buffer, 0, None);
        }
        self.gpu.queue.submit([clear.finish()]);
        let mut ahead = std::mem::take(&mut self.ahead);
        let plan = &self.plan;
        let tapes = [&plan.forward, &plan.loss, &plan.backward];
        let found = self.pass::<f32>(&tapes, &plan.errors, &[&self.pieces], || {
            if let Some(next) = next {
                self.filler.fill(&mut ahead, fill, next);
            }
        });
        self.ahead = ahead;
        let found = found?;
        let Some((pieces, errors)) = found.split_last() else {
            unreachable!("the norm was asked for")
        };
        let sums = self.host.sums(self.cfg(), &self.tokens(errors.iter()));
        let count: usize = self.slots.segments.iter().map(|n| n.div_ceil(PIECE)).sum();
        let norm: f64 = pieces[..count].iter().map(|&x| f64::from(x)).sum();
        let grad_norm = norm.sqrt() / f64::from(self.plan.scale());
        // The step will be skipped. If a factor of 16 bits overflowed, a smaller scale helps.
        if !grad_norm.is_finite() && self.plan.scale() > 1.0 {
            self.plan.rescale(&self.gpu, 0.5 * self.plan.scale());
        }
        Ok(GradientView { sums, grad_norm })
    }

    fn apply(&mut self, lr: f64, view: &GradientView, decay: f64) -> Result<(), robert_net::Error> {
        self.count += 1;
        let update = Update {
            adam: self.adam,
            lr,
            norm: view.grad_norm,
            scale: self.plan.scale(),
            count: self.count,
            share: average_share(self.count, decay),
        };
        for (params, &n) in self.params.iter().zip(&self.slots.segments) {
            self.gpu.queue.write_buffer(params, 0, bytemuck::cast_slice(&update.words(n)));
        }
        self.update.submit(&self.gpu);
        Ok(())
    }

    fn errors(&mut self, fill: &Fill<'_>, index: u64) -> Result<Sums, robert_net::Error> {
        // It is no batch of the training, even if one that is prepared has the same number.
        self.filler.fill(&mut self.host, fill, index);
        let plan = &self.plan;
        let found = self.pass::<f32>(&[&plan.forward, &plan.loss], &plan.errors, &[], || ())?;
        Ok(self.host.sums(self.cfg(), &self.tokens(found.iter())))
    }

    fn infer(&mut self, fill: &Fill<'_>, index: u64) -> Result<Vec<f32>, robert_net::Error> {
        self.filler.fill(&mut self.host, fill, index);
        let found = self.pass::<f32>(&[&self.plan.forward], &self.plan.out, &[], || ())?;
        let outputs = self.cfg().outputs();
        let (stride, rows) = (outputs.next_multiple_of(4), self.plan.windows * WINDOW);
        let mut all = Vec::with_capacity(self.batch * WINDOW * outputs);
        for piece in &found {
            for row in piece.chunks_exact(stride).take(rows) {
                all.extend_from_slice(&row[..outputs]);
            }
        }
        all.truncate(self.batch * WINDOW * outputs);
        Ok(all)
    }

    fn swap_average(&mut self) -> Result<(), robert_net::Error> {
        // The gradient is computed anew before it is needed, so it lends its memory.
        let Some(average) = &self.average else { return Ok(()) };
        let mut encoder =
            self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        for ((w, a), spare) in self.weights.iter().zip(average).zip(&self.grads) {
            for (from, to) in [(w, spare), (a, w), (spare, a)] {
                encoder.copy_buffer_to_buffer(&from.buffer, 0, &to.buffer, 0, from.bytes);
            }
        }
        self.gpu.queue.submit([encoder.finish()]);
        Ok(())
    }

    fn net(&mut self, averaged: bool) -> Result<Net<f32>, robert_net::Error> {
        let from = self.average.as_ref().filter(|_| averaged).unwrap_or(&self.weights);
        let mut weights = robert_linalg::Aligned::zeros(self.net.layout.len);
        weights.copy_from_slice(&self.fetch(from)?);
        Ok(Net { weights, ..self.net.clone() })
    }

    fn state(&mut self) -> Result<OptimiserState, robert_net::Error> {
        Ok(OptimiserState {
            first: self.fetch(&self.first)?,
            second: self.fetch(&self.second)?,
            average: self.average.as_ref().map(|a| self.fetch(a)).transpose()?,
            count: self.count,
        })
    }

    fn restore(&mut self, state: &OptimiserState) -> Result<(), robert_net::Error> {
        let want = self.net.layout.len;
        let average = state.average.as_ref().map_or(want, Vec::len);
        for got in [state.first.len(), state.second.len(), average] {
            if got != want {
                return Err(robert_net::Error::Shape { what: "optimiser state", want, got });
            }
        }
        self.load(&self.first, &state.first);
        self.load(&self.second, &state.second);
        if let (Some(to), Some(from)) = (&self.average, &state.average) {
            self.load(to, from);
        }
        self.count = state.count;
        Ok(())
    }

    fn device(&self) -> Option<DeviceUse> {
        let half = if self.gpu.units().is_some() { ", 16-bit factors" } else { "" };
        let name = format!("{}{half}", self.gpu.name());
        Some(DeviceUse { name, bytes: self.bytes, windows: self.plan.windows })
    }
}

impl Engines for Request {
    fn open(
        &self,
        setup: Setup,
        progress: &dyn Progress,
    ) -> Result<Box<dyn Engine>, robert_net::Error> {
        let number = match self.choice {
            Choice::Cpu => return Ok(Box::new(CpuEngine::new(setup))),
            Choice::Auto => None,
            Choice::Gpu(number) => number,
        };
        let open = |arithmetic| Device::open(number, software_wanted(), arithmetic);
        let opened = match open(self.arithmetic) {
            Err(why @ Error::Half { .. }) => {
                progress.log(&format!("training in 32 bits: {why}"));
                open(Arithmetic::Single)
            }
            opened => opened,
        };
        match opened.and_then(|gpu| GpuEngine::new(gpu, &setup)) {
            Ok(engine) => {
                let at_once = engine.plan.windows;
                let mib = engine.bytes >> 20;
                let pieces = if at_once < setup.batch {
                    format!(", which fits batches of up to {at_once} windows at once")
                } else {
                    String::new()
                };
                progress.log(&format!("training on {}: {mib} MiB{pieces}", engine.gpu.name()));
                Ok(Box::new(engine))
            }
            Err(why) => {
                progress.log(&format!("training on the processor: {why}"));
                Ok(Box::new(CpuEngine::new(setup)))
            }
        }
    }

    fn survives(&self) -> bool {
        self.choice == Choice::Auto
    }
}
