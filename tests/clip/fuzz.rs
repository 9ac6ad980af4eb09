//! Mutated clips: whatever the bytes, no panic, no hang; what is accepted is consistent.
//!
//! 20 000 inputs in a normal run. `ROBERT_FUZZ=1000000 cargo test --test it clip::fuzz`
//! runs as many as asked, from number `ROBERT_FUZZ_FROM` on, and also checks peak memory (alone in
//! its process).

use std::time::{Duration, Instant};

use robert::clip::*;
use robert::rng::Rng;

use super::generate;

const TOKENS: &[&str] = &[
    "null",
    "true",
    "-",
    "0",
    "1e999",
    "-1e308",
    "NaN",
    "99999999999",
    "-0",
    "0.1e-5",
    "\"",
    "\\",
    "\\u0000",
    "\\ud83d",
    "{",
    "}",
    "[",
    "]",
    ",",
    ":",
    "\"frame\": ",
    "\"q\": [0]",
    "\"pose\": \"rest\"",
    "\"hold\": 100000",
    "\"fill\": \"cubic\"",
    "\"masks\": [{\"from\": 0, \"to\": 1}]",
    "\"length\": 100000",
    "\"x\": {}",
    "\u{feff}",
    "\u{1F916}",
    "\n",
    "//",
    "\"joints\": [\"a\"]",
    "\"robert-clip/2\"",
];

fn mutate(bytes: &mut Vec<u8>, r: &mut Rng) {
    for _ in 0..=r.below(5) {
        let n = bytes.len() as u64;
        let at = r.below(n + 1) as usize;
        let some = |r: &mut Rng| (at + r.below(24) as usize).min(n as usize);
        match r.below(8) {
            0 if n > 0 => bytes[at.min(n as usize - 1)] ^= 1 << r.below(8),
            1 => bytes.insert(at, r.below(256) as u8),
            2 => {
                let end = some(r);
                bytes.drain(at..end);
            }
            3 => {
                let end = some(r);
                let piece = bytes[at..end].to_vec();
                let to = r.below(n + 1) as usize;
                bytes.splice(to..to, piece);
            }
            4 | 5 => {
                let token = TOKENS[r.below(TOKENS.len() as u64) as usize];
                let end = if r.below(2) == 0 { at } else { some(r) };
                bytes.splice(at..end, token.bytes());
            }
            6 => {
                // A digit becomes another: frames, lengths and holds stay numbers.
                if let Some(d) = bytes.iter().skip(at).position(u8::is_ascii_digit) {
                    bytes[at + d] = b'0' + r.below(10) as u8;
                }
            }
            _ => bytes.truncate(at.max(n as usize / 2)),
        }
    }
}

/// Everything that is done with a clip that was accepted.
fn exercise(bytes: Vec<u8>) -> bool {
    let parsed = match parse_bytes(bytes) {
        Ok(parsed) => parsed,
        Err(e) => {
            let (line, col) = e.line_col().expect("every refusal has a place");
            assert!(line >= 1 && col >= 1 && e.to_string().len() < 2000);
            return false;
        }
    };
    let clip = parsed.clip.clone();
    let text = clip.to_text();
    let back = Clip::parse(&text).expect("our own text");
    assert_eq!(back, clip);
    assert_eq!(back.to_text(), text);
    let command = compile(&clip).expect("an accepted clip compiles");
    assert!(command.q().iter().all(|v| v.is_finite()));
    let lints = lint(&clip, &command, &generate::table(&clip), None);
    let places = parsed.places(lints.iter().map(|found| found.pointer.as_str()));
    assert_eq!(places.len(), lints.len());
    for found in lints {
        for fix in found.fixes {
            edited(&clip, &fix.op, None).expect("fixes apply");
        }
    }
    if clip.length < 2000 {
        let csv = formats::to_csv(&command);
        let back = formats::from_csv(csv.as_bytes(), Some(&clip.robot), Fill::Mask);
        let back = back.unwrap_or_else(|e| panic!("{e}\n{text}"));
        assert_eq!(compile(&back).unwrap().first_changed_frame(&command), None, "{text}");
    }
    true
}

#[test]
fn mutated_clips_never_panic_or_hang() {
    let number = |name| std::env::var(name).ok().and_then(|n| n.parse::<u64>().ok());
    let asked = number("ROBERT_FUZZ");
    let (inputs, first) = (asked.unwrap_or(20_000), number("ROBERT_FUZZ_FROM").unwrap_or(0));
    let seeds: Vec<Vec<u8>> = (0..40).map(|i| generate::clip(i).to_text().into_bytes()).collect();
    let (mut accepted, mut slowest) = (0_u64, Duration::ZERO);
    let begin = Instant::now();
    for i in first..first + inputs {
        let r = &mut generate::rng(11, i);
        let mut bytes = seeds[r.below(seeds.len() as u64) as usize].clone();
        mutate(&mut bytes, r);
        let start = super::cpu();
        accepted += u64::from(exercise(bytes));
        slowest = slowest.max(super::cpu().saturating_sub(start));
    }
    assert!(slowest < Duration::from_secs(1), "{slowest:?}");
    assert!(accepted > inputs / 50, "the mutator only makes rubbish: {accepted} of {inputs}");
    if asked.is_some() {
        let status = std::fs::read_to_string("/proc/self/status").unwrap();
        let peak = status.lines().find_map(|l| l.strip_prefix("VmHWM:")).unwrap_or_default();
        let kb: u64 = peak.trim().trim_end_matches(" kB").parse().unwrap();
        println!(
            "clip: {inputs} inputs, {accepted} taken, {:.0} s, slowest {slowest:?}, peak {kb} kB",
            begin.elapsed().as_secs_f64()
        );
        assert!(kb < 256 << 10, "{kb} kB");
    }
}
