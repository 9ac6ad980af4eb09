//! The cards of this machine and the choice among them.

use std::str::FromStr;

use super::Error;

/// The environment variable that admits the software driver: `ROBERT_GPU=software`.
pub const VARIABLE: &str = "ROBERT_GPU";

/// The processor that trains or performs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Choice {
    /// A graphics card if there is one, else the processor.
    Auto,
    /// The processor.
    #[default]
    Cpu,
    /// A graphics card, by its number if one is given.
    Gpu(Option<usize>),
}

impl FromStr for Choice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => Ok(Choice::Auto),
            "cpu" => Ok(Choice::Cpu),
            "gpu" => Ok(Choice::Gpu(None)),
            _ => {
                let number = text.strip_prefix("gpu:").and_then(|n| n.parse().ok());
                number
                    .map(|n| Choice::Gpu(Some(n)))
                    .ok_or_else(|| "expected auto, cpu, gpu or gpu:N".to_owned())
            }
        }
    }
}

impl std::fmt::Display for Choice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Choice::Auto => f.write_str("auto"),
            Choice::Cpu => f.write_str("cpu"),
            Choice::Gpu(None) => f.write_str("gpu"),
            Choice::Gpu(Some(n)) => write!(f, "gpu:{n}"),
        }
    }
}

/// How a card multiplies matrices.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Arithmetic {
    /// In 32 bits.
    #[default]
    Single,
    /// Factors rounded to 16 bits, sums in 32, on the card's matrix units. Everything else, and
    /// the weights, are in 32 bits.
    Half,
}

/// What an engine is asked to run on.
#[derive(Clone, Copy, Debug, Default)]
pub struct Request {
    /// The processor or a card.
    pub choice: Choice,
    /// How a card multiplies.
    pub arithmetic: Arithmetic,
}

/// A graphics card.
#[derive(Clone, Debug)]
pub struct Card {
    /// Its name and its driver.
    pub name: String,
    /// Whether it is a driver that computes on the processor.
    pub software: bool,
    /// The most bytes that a kernel may see of one buffer.
    pub binding_bytes: u64,
    /// The most bytes for the activations of a step. A card without its own memory takes them from
    /// the processor's.
    pub(crate) activation_bytes: u64,
    pub(crate) adapter: wgpu::Adapter,
}

/// Whether the software driver counts as a card, by the environment.
pub fn software_wanted() -> bool {
    std::env::var_os(VARIABLE).is_some_and(|v| v == "software")
}

/// The cards, discrete ones first; only software drivers if `software`, else only real cards.
pub fn cards(software: bool) -> Vec<Card> {
    let mut found = all();
    found.retain(|c| c.software == software);
    found
}

/// All adapters that can compute, real ones first.
fn all() -> Vec<Card> {
    let backends = wgpu::Backends::VULKAN | wgpu::Backends::METAL | wgpu::Backends::DX12;
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends,
        flags: wgpu::InstanceFlags::empty(),
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let mut found: Vec<_> = pollster::block_on(instance.enumerate_adapters(backends))
        .into_iter()
        .map(|adapter| {
            let info = adapter.get_info();
            let rank = match info.device_type {
                wgpu::DeviceType::DiscreteGpu => 0,
                wgpu::DeviceType::IntegratedGpu => 1,
                wgpu::DeviceType::VirtualGpu => 2,
                wgpu::DeviceType::Other => 3,
                wgpu::DeviceType::Cpu => 4,
            };
            let card = Card {
                name: info.name,
                software: info.device_type == wgpu::DeviceType::Cpu,
                binding_bytes: adapter.limits().max_storage_buffer_binding_size,
                activation_bytes: match info.device_type {
                    wgpu::DeviceType::Cpu => 1 << 29,
                    wgpu::DeviceType::IntegratedGpu => 1 << 31,
                    _ => 1 << 34,
                },
                adapter,
            };
            (rank, card)
        })
        .collect();
    found.sort_by_key(|(rank, _)| *rank);
    found.into_iter().map(|(_, card)| card).collect()
}

/// The card of this number, or the first.
///
/// # Errors
/// [`Error::Absent`] without any, [`Error::Number`] for a number that none has.
pub fn choose(number: Option<usize>, software: bool) -> Result<Card, Error> {
    let mut found = cards(software);
    let names: Vec<String> = found.iter().map(|c| c.name.clone()).collect();
    let at = pick(&names, number, software)?;
    Ok(found.swap_remove(at))
}

fn pick(names: &[String], number: Option<usize>, software: bool) -> Result<usize, Error> {
    if names.is_empty() {
        let why = if software {
            "no software driver was found (sudo apt-get install mesa-vulkan-drivers)".to_owned()
        } else {
            format!(
                "no graphics card was found through Vulkan (robert doctor says more; {VARIABLE}=software admits the software driver)"
            )
        };
        return Err(Error::Absent { why });
    }
    match number {
        Some(number) if number >= names.len() => {
            let known: Vec<_> =
                names.iter().enumerate().map(|(i, n)| format!("gpu:{i} {n}")).collect();
            Err(Error::Number { number, known: known.join(", ") })
        }
        number => Ok(number.unwrap_or(0)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn choices_are_written_as_they_are_read() {
        for text in ["auto", "cpu", "gpu", "gpu:0", "gpu:11"] {
            assert_eq!(text.parse::<Choice>().unwrap().to_string(), text);
        }
        for bad in ["", "gpu:", "gpu:-1", "cuda", "gpu 0"] {
            assert!(bad.parse::<Choice>().unwrap_err().contains("gpu:N"), "{bad}");
        }
    }

    #[test]
    fn a_number_that_no_card_has_is_an_error_with_those_that_exist() {
        let names = ["A".to_owned(), "B".to_owned()];
        assert_eq!(pick(&names, None, false).unwrap(), 0);
        assert_eq!(pick(&names, Some(1), false).unwrap(), 1);
        let e = pick(&names, Some(2), false).unwrap_err().to_string();
        assert!(e.contains("gpu:2") && e.contains("gpu:1 B"), "{e}");
        let e = pick(&[], Some(0), false).unwrap_err();
        assert!(matches!(e, Error::Absent { .. }) && e.to_string().contains("software"), "{e}");
    }
}
