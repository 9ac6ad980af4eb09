//! The forward pass of many rollouts on a card.
//!
//! Each rollout brings a window and waits. The first rollout that finds the card free computes all
//! windows that wait, while new ones gather. A window's result does not depend on the others,
//! because every row of a product is summed by itself in a fixed order. So an evaluation has the
//! same bits with any number of threads.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use robert_net::forward::{Forward, Forwards};
use robert_net::{Batch, Net, NetConfig, WINDOW};

use super::adapter::{Arithmetic, Choice, software_wanted};
use super::device::Device;
use super::plan::{Kernels, Plan, Segments, per_window};
use super::slots::Slots;
use super::{Error, Room};

/// A card for the networks of an evaluation.
#[derive(Debug)]
pub struct GpuForwards {
    gpu: Arc<Device>,
    windows: usize,
    /// Why networks are with the processor, in order.
    notes: Arc<Mutex<Vec<String>>>,
}

impl GpuForwards {
    /// Computes up to `windows` windows at once on this card.
    pub fn new(gpu: Device, windows: usize) -> Self {
        GpuForwards { gpu: Arc::new(gpu), windows: windows.max(1), notes: Arc::default() }
    }

    /// The card.
    pub fn gpu(&self) -> &Device {
        &self.gpu
    }

    /// Messages for people: networks that do not fit, and a card that was lost.
    pub fn notes(&self) -> Vec<String> {
        lock(&self.notes).clone()
    }
}

impl Choice {
    /// The chosen card for the networks of an evaluation, `windows` rollouts at once; none for the
    /// processor.
    ///
    /// # Errors
    /// As [`Device::open`].
    pub fn forwards(self, windows: usize) -> Result<Option<GpuForwards>, Error> {
        let number = match self {
            Choice::Cpu => return Ok(None),
            Choice::Auto => None,
            Choice::Gpu(number) => number,
        };
        Ok(Some(GpuForwards::new(
            Device::open(number, software_wanted(), Arithmetic::Single)?,
            windows,
        )))
    }
}

impl Forwards for GpuForwards {
    fn open(&self, net: &Net<f32>) -> Option<Arc<dyn Forward>> {
        match GpuForward::new(&self.gpu, net, self.windows, &self.notes) {
            Ok(forward) => Some(Arc::new(forward)),
            Err(why) => {
                lock(&self.notes).push(format!("the processor performs: {why}"));
                None
            }
        }
    }
}

/// Weights and activations of a network on a card.
#[derive(Debug)]
struct GpuForward {
    gpu: Arc<Device>,
    cfg: NetConfig,
    plan: Plan,
    desk: Mutex<Desk>,
    changed: Condvar,
    notes: Arc<Mutex<Vec<String>>>,
}

/// Windows that wait, and results that nobody has fetched yet.
#[derive(Debug, Default)]
struct Desk {
    waiting: Vec<Window>,
    done: BTreeMap<u64, Vec<f32>>,
    /// The number of the next window.
    next: u64,
    /// Somebody computes.
    busy: bool,
    lost: bool,
}

/// A window on its way to the card.
#[derive(Debug)]
struct Window {
    number: u64,
    tokens: Vec<f32>,
    info: Vec<[u32; 4]>,
}

impl GpuForward {
    fn new(
        gpu: &Arc<Device>,
        net: &Net<f32>,
        windows: usize,
        notes: &Arc<Mutex<Vec<String>>>,
    ) -> Result<Self, Error> {
        let device = || gpu.name().to_owned();
        let unfit = |why| Error::Unfit { device: device(), why };
        let Room { binding_bytes, activation_bytes } = gpu.room();
        let most = usize::try_from(binding_bytes / 4).unwrap_or(usize::MAX);
        let slots = Slots::new(&net.layout, most).map_err(unfit)?;
        let (window, largest) = per_window(&net.cfg, gpu.factor_bytes());
        let room = usize::try_from(activation_bytes / window).unwrap_or(usize::MAX);
        let mut windows = windows.min(room).min(most / largest.max(1));
        if windows == 0 {
            return Err(unfit(format!("a kernel sees {binding_bytes} bytes of a buffer")));
        }
        let kernels = Kernels::new(gpu);
        loop {
            let make = || {
                let set = slots.segments.iter().map(|&n| gpu.buffer(4 * n as u64));
                let weights: Segments = set.collect();
                let plan = Plan::forward_only(gpu, &kernels, net, &slots, &weights, windows);
                (weights, plan)
            };
            let made = gpu.allocate(make).map_err(|why| Error::Broken { device: device(), why })?;
            if let Some((weights, plan)) = made {
                for (span, numbers) in weights.iter().zip(slots.spread(&net.weights)) {
                    gpu.write(span, &numbers);
                }
                let (gpu, cfg, notes) = (Arc::clone(gpu), net.cfg.clone(), Arc::clone(notes));
                let (desk, changed) = (Mutex::default(), Condvar::new());
                return Ok(GpuForward { gpu, cfg, plan, desk, changed, notes });
            }
            if windows == 1 {
                let needs = 4 * slots.segments.iter().sum::<usize>() as u64 + window;
                return Err(Error::Memory { device: device(), needs_mib: needs.div_ceil(1 << 20) });
            }
            windows /= 2;
        }
    }

    /// Computes these windows; (51, stride) of each.
    fn compute(&self, windows: &[Window]) -> Result<Vec<Vec<f32>>, String> {
        let (plan, gpu) = (&self.plan, &self.gpu);
        let tokens: Vec<f32> = windows.iter().flat_map(|w| w.tokens.iter().copied()).collect();
        let info: Vec<[u32; 4]> = windows.iter().flat_map(|w| w.info.iter().copied()).collect();
        gpu.write(&plan.tokens, &tokens);
        gpu.write(&plan.info, &info);
        plan.forward.submit(gpu);
        let stride = self.cfg.outputs().next_multiple_of(4);
        let size = WINDOW * stride;
        let used = plan.out.part(0, 4 * (windows.len() * size) as u64);
        let read = gpu.read::<f32>(&[&used], || ())?;
        Ok(read.iter().flat_map(|all| all.chunks_exact(size).map(<[f32]>::to_vec)).collect())
    }

    /// Takes the windows that wait, as many as fit, and computes them.
    fn serve<'a>(&'a self, mut desk: MutexGuard<'a, Desk>) -> MutexGuard<'a, Desk> {
        let count = desk.waiting.len().min(self.plan.windows);
        let now: Vec<Window> = desk.waiting.drain(..count).collect();
        desk.busy = true;
        drop(desk);
        let found = self.compute(&now);
        let mut desk = lock(&self.desk);
        desk.busy = false;
        match found {
            Ok(all) => desk.done.extend(now.iter().map(|w| w.number).zip(all)),
            Err(why) => {
                desk.lost = true;
                let name = self.gpu.name();
                lock(&self.notes).push(format!("{name} is lost, the processor goes on: {why}"));
            }
        }
        self.changed.notify_all();
        desk
    }
}

impl Forward for GpuForward {
    fn run(&self, window: &Batch<f32>, rows: Range<usize>) -> Option<Vec<f32>> {
        let (inputs, outputs) = (self.cfg.inputs, self.cfg.outputs());
        let mut tokens = vec![0.0; WINDOW * inputs.next_multiple_of(4)];
        let padded = tokens.chunks_exact_mut(inputs.next_multiple_of(4));
        for (to, from) in padded.zip(window.tokens.chunks_exact(inputs)) {
            to[..inputs].copy_from_slice(from);
        }
        let info = window.masked[..WINDOW].iter().map(|m| [u32::from(*m), 0, 0, 0]).collect();
        let mut desk = lock(&self.desk);
        let number = desk.next;
        desk.next += 1;
        desk.waiting.push(Window { number, tokens, info });
        let all = loop {
            if let Some(found) = desk.done.remove(&number) {
                break found;
            }
            if desk.lost {
                return None;
            }
            desk = if desk.busy {
                self.changed.wait(desk).unwrap_or_else(PoisonError::into_inner)
            } else {
                self.serve(desk)
            };
        };
        drop(desk);
        let stride = outputs.next_multiple_of(4);
        let wanted = all.chunks_exact(stride).skip(rows.start).take(rows.len());
        Some(wanted.flat_map(|row| row[..outputs].iter().copied()).collect())
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
