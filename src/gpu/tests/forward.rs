//! Windows of many rollouts together: the processor's answers, the same bits in any company.

use super::steps::{config, setup, window};
use super::{close, device, narrow};
use crate::{Device, GpuForwards};
use robert_net::forward::{Forward, Forwards};
use robert_net::{Batch, CURRENT, CpuEngine, Engine, Mixing, NetConfig, Setup, SkipKind, WINDOW};
use std::sync::Arc;

const WINDOWS: usize = 13;

fn open(gpu: Device, setup: &Setup, at_once: usize) -> (GpuForwards, Arc<dyn Forward>) {
    let card = GpuForwards::new(gpu, at_once);
    let forward = card.open(&setup.net);
    let notes = card.notes();
    (card, forward.unwrap_or_else(|| panic!("{notes:?}")))
}

/// The results of the rows from the current frame on, for every window, requested by this many
/// threads.
fn asked(forward: &dyn Forward, setup: &Setup, threads: usize) -> Vec<Vec<f32>> {
    let one = |w: usize| {
        let mut batch = Batch::zeros(&setup.net.cfg, 1);
        window(3, w, 0, &mut batch);
        (w, forward.run(&batch, CURRENT..CURRENT + 3).unwrap())
    };
    let mut all: Vec<(usize, Vec<f32>)> = std::thread::scope(|scope| {
        let each = |t: usize| scope.spawn(move || (t..WINDOWS).step_by(threads).map(one).collect());
        let handles: Vec<_> = (0..threads).map(each).collect();
        handles.into_iter().flat_map(|h| -> Vec<_> { h.join().unwrap() }).collect()
    });
    all.sort_by_key(|(w, _)| *w);
    all.into_iter().map(|(_, out)| out).collect()
}

#[test]
fn rollouts_get_their_own_answers_whoever_asks_beside_them() {
    let variants = [
        config(1, SkipKind::Gated, true),
        config(4, SkipKind::Off, false),
        NetConfig { mixing: Mixing::None, ..config(1, SkipKind::Additive, false) },
    ];
    for cfg in variants {
        let Some(gpu) = device() else { return };
        let setup = setup(&cfg, WINDOWS, 0.1);
        let want = CpuEngine::new(setup.clone()).infer(&window, 3).unwrap();
        let (card, forward) = open(gpu, &setup, 4);
        let alone = asked(&*forward, &setup, 1);
        let k = cfg.outputs();
        for (w, got) in alone.iter().enumerate() {
            let from = (w * WINDOW + CURRENT) * k;
            close(got, &want[from..from + 3 * k], 1e-4, &format!("window {w}"));
        }
        for threads in [3, WINDOWS] {
            assert_eq!(asked(&*forward, &setup, threads), alone, "{threads} threads");
        }
        assert!(card.notes().is_empty());
    }
}

#[test]
fn what_does_not_fit_and_what_is_lost_is_said() {
    let Some(gpu) = device() else { return };
    let setup = setup(&config(1, SkipKind::Gated, true), 1, 0.1);
    let (card, forward) = open(gpu, &setup, 4);
    let mut batch = Batch::zeros(&setup.net.cfg, 1);
    window(3, 0, 0, &mut batch);
    assert!(forward.run(&batch, CURRENT..CURRENT + 1).is_some());
    card.gpu().lose();
    assert!(forward.run(&batch, CURRENT..CURRENT + 1).is_none());
    assert!(forward.run(&batch, CURRENT..CURRENT + 1).is_none());
    assert!(card.notes()[0].contains("is lost, the processor goes on"), "{:?}", card.notes());
    let Some(gpu) = narrow() else { return };
    let wide = NetConfig { width: 512, layers: 1, ..config(1, SkipKind::Gated, true) };
    let card = GpuForwards::new(gpu, 4);
    assert!(card.open(&super::steps::setup(&wide, 1, 0.1).net).is_none());
    assert!(card.notes()[0].contains("the processor performs"), "{:?}", card.notes());
}
