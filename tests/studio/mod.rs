//! The studio through its port, as browsers, scripts and attackers meet it.

mod client;
mod crash;
mod dragging;
mod editing;
mod files;
mod guard;
mod hand;
mod hostile;
mod measure;
mod pages;
mod simulation;
mod stalled;
mod takes;
mod viewport;

pub(crate) use client::CLIP;
