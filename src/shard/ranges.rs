//! Lists of indices as people and queues write them.

use super::plan::SHARDS;

/// `0-3,7,9-10` of sorted indices.
pub fn ranges(indices: &[usize]) -> String {
    let mut parts: Vec<(usize, usize)> = Vec::new();
    for &i in indices {
        match parts.last_mut() {
            Some((_, to)) if *to + 1 == i => *to = i,
            _ => parts.push((i, i)),
        }
    }
    let text = |(a, b): &(usize, usize)| if a == b { a.to_string() } else { format!("{a}-{b}") };
    parts.iter().map(text).collect::<Vec<_>>().join(",")
}

/// The indices in such a text; `None` if it is malformed, or names more than a plan can have.
pub(super) fn indices(text: &str) -> Option<Vec<usize>> {
    let mut all = Vec::new();
    for part in text.trim().split(',') {
        let (a, b) = part.split_once('-').unwrap_or((part, part));
        let (a, b): (usize, usize) = (a.parse().ok()?, b.parse().ok()?);
        if b >= SHARDS || all.len() >= SHARDS {
            return None;
        }
        all.extend(a..=b);
    }
    Some(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_become_ranges() {
        for (list, text) in [(&[0, 1, 2, 7, 9, 10][..], "0-2,7,9-10"), (&[5], "5")] {
            assert_eq!(ranges(list), text);
            assert_eq!(indices(text).unwrap(), list);
        }
        assert_eq!(ranges(&[]), "");
        assert_eq!(indices("3-x"), None);
        assert_eq!(indices(&format!("0-{}", SHARDS - 1)).unwrap().len(), SHARDS);
        assert_eq!(indices(&format!("0-{SHARDS}")), None);
        assert_eq!(indices(&format!("0-{}", usize::MAX)), None);
        assert_eq!(indices(&vec!["0-99999"; 50_000].join(",")), None);
    }
}
