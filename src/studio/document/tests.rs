//! Tests of what a document keeps, and of what is recovered.

use super::journal::{Journal, Record};
use super::{Document, Edit};
use crate::protocol::Error;
use robert_base::rng::{Rng, Stream};
use robert_clip::{Clip, ClipRename, Delta, Key, KeysAdd, Op, RobotRef};

fn blank() -> Clip {
    let joints = vec!["a".to_owned(), "b".to_owned()];
    let mut clip = Clip::new(RobotRef { id: "r".into(), joints, ..RobotRef::default() }, 100);
    clip.keys.push(Key::new(0, &[0.0, 0.0]));
    clip
}

fn add(frame: u32) -> Edit {
    let keys = vec![Key::new(frame, &[0.5, 1.0])];
    Edit::Op(Box::new(Op::KeysAdd(KeysAdd { keys, replace: true })))
}

#[test]
fn comes_back_with_history_and_undoes_to_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.clip.json");
    // Not our layout, yet it must come back as it was.
    let text = blank().to_text().replace('\n', "\n ").trim_end().to_owned();
    std::fs::write(&path, &text).unwrap();
    let mut doc = Document::open(&path, dir.path(), |_| None).unwrap();
    assert!(!doc.is_dirty() && doc.text() == text);
    let answers = doc.edit(&[add(20), add(40), Edit::Undo, add(50)]);
    assert!(answers.iter().all(Result::is_ok));
    let (clip, history) = (doc.clip().clone(), doc.history().0);
    drop(doc); // as a kill would
    let mut doc = Document::open(&path, dir.path(), |_| None).unwrap();
    assert_eq!((doc.clip(), doc.history().0), (&clip, history));
    assert_eq!(doc.restored().unwrap().edits, 2, "an undo is none, and takes one away");
    doc.edit(&[Edit::Goto(0)]).pop().unwrap().unwrap();
    assert_eq!(doc.text(), text);
    doc.close();
    assert!(!path.with_file_name("a.clip.json.autosave").exists());
}

#[test]
fn saving_compacts_and_moving_takes_the_lock_along() {
    let dir = tempfile::tempdir().unwrap();
    let mut doc = Document::new(blank(), dir.path(), None).unwrap();
    assert!(matches!(doc.save(None, false, dir.path()), Err(Error::Untitled)));
    doc.edit(&[add(30)]);
    let path = dir.path().join("b.clip.json");
    doc.save(Some(&path), false, dir.path()).unwrap();
    assert!(!doc.is_dirty());
    assert!(matches!(Document::open(&path, dir.path(), |_| None), Err(Error::Locked { .. })));
    assert_eq!(std::fs::read_to_string(&path).unwrap(), doc.clip().to_text());
    // The saved journal does not know this edit any more, and yet its undo is kept.
    for (edit, there) in [(Edit::Undo, false), (Edit::Redo, true), (Edit::Undo, false)] {
        doc.edit(&[edit]);
        let killed = dir.path().join("killed.clip.json");
        std::fs::copy(&path, &killed).unwrap();
        std::fs::copy(
            dir.path().join("b.clip.json.autosave"),
            dir.path().join("killed.clip.json.autosave"),
        )
        .unwrap();
        let back = Document::open(&killed, dir.path(), |_| None).unwrap();
        assert_eq!(back.clip().key(30).is_some(), there);
        assert_eq!(back.clip(), doc.clip());
    }
    assert!(Document::orphan(dir.path(), |_| None).is_none());
}

#[test]
fn saving_under_another_name_loses_no_edits_of_the_clip_there() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.clip.json");
    std::fs::write(&path, blank().to_text()).unwrap();
    let mut other = Document::open(&path, dir.path(), |_| None).unwrap();
    other.edit(&[add(20)]);
    other.close();
    let mut doc = Document::new(blank(), dir.path(), None).unwrap();
    doc.edit(&[add(30)]);
    let refused = doc.save(Some(&path), true, dir.path()).unwrap_err().to_string();
    assert!(refused.contains("edits that are not saved"), "{refused}");
    let back = Document::open(&path, dir.path(), |_| None).unwrap();
    assert!(back.clip().key(20).is_some() && back.is_dirty());
    back.close();
    // Without its clip nobody could open them: a copy stays.
    std::fs::remove_file(&path).unwrap();
    doc.save(Some(&path), false, dir.path()).unwrap();
    assert!(dir.path().join("a.clip.json.autosave.damaged").exists());
    // A file that cannot be written leaves nothing behind.
    let folder = dir.path().join("folder.clip.json");
    std::fs::create_dir(&folder).unwrap();
    assert!(doc.save(Some(&folder), true, dir.path()).is_err());
    assert!(!dir.path().join("folder.clip.json.autosave").exists());
}

#[test]
fn a_file_has_one_journal_whichever_link_leads_to_it() {
    let dir = tempfile::tempdir().unwrap();
    let (folder, file) = (dir.path().join("clips"), dir.path().join("clips/wave.clip.json"));
    std::fs::create_dir(&folder).unwrap();
    std::fs::write(&file, blank().to_text()).unwrap();
    let link = dir.path().join("link.clip.json");
    std::os::unix::fs::symlink("clips/wave.clip.json", &link).unwrap();
    let linked_folder = dir.path().join("linked");
    std::os::unix::fs::symlink("clips", &linked_folder).unwrap();
    let open = |path: &std::path::Path| Document::open(path, dir.path(), |_| None);
    let mut doc = open(&link).unwrap();
    doc.edit(&[add(20)]);
    for other in [&file, &linked_folder.join("wave.clip.json")] {
        assert!(matches!(open(other), Err(Error::Locked { .. })), "{}", other.display());
    }
    drop(doc);
    let mut doc = open(&file).unwrap();
    assert!(doc.clip().key(20).is_some(), "the edits that were made through the link");
    // Saving under the link's name is saving the same file.
    doc.save(Some(&link), false, dir.path()).unwrap();
    assert_eq!(doc.path(), Some(link.as_path()));
    assert!(std::fs::symlink_metadata(&link).unwrap().is_symlink(), "the link stays one");
    assert_eq!(std::fs::read_to_string(&file).unwrap(), doc.text());
    doc.edit(&[add(40)]);
    drop(doc);
    assert!(open(&file).unwrap().clip().key(40).is_some());
    // A link to a file that is not there yet.
    let ahead = dir.path().join("ahead.clip.json");
    std::os::unix::fs::symlink("clips/new.clip.json", &ahead).unwrap();
    let mut doc = Document::new(blank(), dir.path(), None).unwrap();
    doc.save(Some(&ahead), false, dir.path()).unwrap();
    doc.edit(&[add(60)]);
    drop(doc);
    assert!(open(&folder.join("new.clip.json")).unwrap().clip().key(60).is_some());
}

#[test]
fn an_unsaved_clip_is_found_again() {
    let dir = tempfile::tempdir().unwrap();
    let mut doc = Document::new(blank(), dir.path(), None).unwrap();
    let rename = ClipRename { name: "wave".into() };
    doc.edit(&[Edit::Op(Box::new(Op::ClipRename(rename)))]);
    assert!(Document::orphan(dir.path(), |_| None).is_none(), "it is in use");
    // Another beside it: both stay within reach.
    let mut other = Document::new(blank(), dir.path(), None).unwrap();
    let rename = ClipRename { name: "nod".into() };
    other.edit(&[Edit::Op(Box::new(Op::ClipRename(rename)))]);
    let untouched = Document::new(blank(), dir.path(), None).unwrap();
    drop((doc, other, untouched));
    let mut names: Vec<String> = Document::drafts(dir.path()).into_iter().map(|d| d.name).collect();
    names.sort();
    assert_eq!(names, ["nod", "wave"]);
    let doc = Document::orphan(dir.path(), |_| None).unwrap();
    assert_eq!(doc.clip().name, "nod", "the newest");
    assert!(doc.is_dirty() && doc.path().is_none());
    let left = Document::drafts(dir.path());
    assert_eq!(left.len(), 1, "the other one is open: {left:?}");
    let number = left.first().unwrap().number;
    assert_eq!(Document::draft(dir.path(), number, |_| None).unwrap().clip().name, "wave");
    Document::drop_draft(dir.path(), number).unwrap();
    assert!(Document::drafts(dir.path()).is_empty());
    assert!(matches!(Document::draft(dir.path(), number, |_| None), Err(Error::NotFound { .. })));
}

#[test]
fn the_newest_draft_is_first_within_one_second_too() {
    let dir = tempfile::tempdir().unwrap();
    let mut docs = [(); 2].map(|()| Document::new(blank(), dir.path(), None).unwrap());
    for doc in &mut docs {
        doc.edit(&[add(20)]);
    }
    drop(docs);
    let mut numbers: Vec<u32> = Document::drafts(dir.path()).iter().map(|d| d.number).collect();
    numbers.sort_unstable();
    let second = std::time::SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(1 << 30);
    for (number, millis) in numbers.iter().zip([900, 100]) {
        let journal = dir.path().join(format!("untitled-{number}.autosave"));
        let file = std::fs::File::options().append(true).open(journal).unwrap();
        file.set_modified(second + std::time::Duration::from_millis(millis)).unwrap();
    }
    assert_eq!(Document::drafts(dir.path())[0].number, numbers[0]);
}

#[test]
fn what_was_put_away_is_a_draft_and_what_was_killed_comes_back() {
    let dir = tempfile::tempdir().unwrap();
    let mut doc = Document::new(blank(), dir.path(), None).unwrap();
    doc.edit(&[add(20), add(40)]);
    doc.close();
    assert!(Document::orphan(dir.path(), |_| None).is_none(), "nothing was killed");
    let [draft] = &Document::drafts(dir.path())[..] else { panic!("it is kept") };
    assert!(!draft.abandoned);
    // Taken up again it is whole, and a kill before any further edit is a kill.
    let doc = Document::draft(dir.path(), draft.number, |_| None).unwrap();
    assert_eq!((doc.restored(), doc.history().1), (None, 2), "nothing had to be recovered");
    drop(doc);
    assert!(Document::drafts(dir.path())[0].abandoned);
    let doc = Document::orphan(dir.path(), |_| None).unwrap();
    assert_eq!(doc.restored().unwrap().edits, 2);
    assert_eq!(doc.clip().keys.len(), 3);
}

#[test]
fn a_file_that_was_put_away_is_not_one_that_was_killed() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("wave.clip.json");
    std::fs::write(&file, blank().to_text()).unwrap();
    let open = || Document::open(&file, dir.path(), |_| None).unwrap();
    let left = || Document::left_open(&file, dir.path(), |_| None);
    assert!(left().unwrap().is_none());
    let mut doc = open();
    assert!(matches!(left(), Err(Error::Locked { .. })), "it is in use");
    doc.edit(&[add(20)]);
    drop(doc);
    let doc = left().unwrap().unwrap();
    assert_eq!(doc.restored().unwrap().edits, 1);
    doc.close();
    assert!(left().unwrap().is_none(), "its edits wait, but nothing was killed");
    let doc = open();
    assert!(doc.restored().is_none() && doc.is_dirty(), "its user left it so");
    drop(doc);
    let mut doc = left().unwrap().expect("killed before any further edit");
    assert_eq!((doc.restored().unwrap().edits, doc.history().1), (1, 1));
    doc.put_aside();
    drop(doc);
    assert!(left().unwrap().is_none(), "a start that failed on it is not repeated");
    let mut doc = open();
    doc.discard().unwrap();
    doc.close();
    assert!(left().unwrap().is_none());
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "no journal is left");
}

#[test]
fn what_was_all_undone_is_not_recovered_and_a_changed_file_is_told_of() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("wave.clip.json");
    std::fs::write(&file, blank().to_text()).unwrap();
    let open = || Document::open(&file, dir.path(), |_| None).unwrap();
    let mut doc = open();
    doc.edit(&[add(20), add(40), Edit::Undo, Edit::Undo]);
    drop(doc);
    let mut doc = open();
    assert_eq!((doc.restored(), doc.history()), (None, (2, 0)), "redo is left");
    doc.edit(&[Edit::Redo]);
    doc.close();
    let mut other = blank();
    other.name = "of another program".into();
    std::fs::write(&file, other.to_text()).unwrap();
    let mut doc = open();
    let told = doc.restored().expect("saving would overwrite what the other program wrote");
    assert_eq!((told.edits, told.file_changed), (1, true));
    // What was all undone must not come back in place of the changed file.
    doc.edit(&[Edit::Undo]);
    drop(doc);
    let doc = open();
    assert_eq!((doc.restored(), doc.is_dirty(), doc.history()), (None, false, (0, 0)));
    assert_eq!(doc.clip().name, "of another program");
}

#[test]
fn two_who_look_for_drafts_at_once_both_find_all() {
    let dir = tempfile::tempdir().unwrap();
    for _ in 0..4 {
        let mut doc = Document::new(blank(), dir.path(), None).unwrap();
        doc.edit(&[add(20)]);
        doc.close();
    }
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                for _ in 0..50 {
                    assert_eq!(Document::drafts(dir.path()).len(), 4);
                }
            });
        }
    });
}

/// Bytes that this thread has read from files and written into them.
fn moved_bytes() -> [u64; 2] {
    let text = std::fs::read_to_string("/proc/thread-self/io").unwrap();
    let number = |name: &str| {
        let line = text.lines().find_map(|l| l.strip_prefix(name)).unwrap();
        line.trim().parse().unwrap()
    };
    [number("rchar:"), number("wchar:")]
}

/// A journal is read a fixed number of times, however many edits it has. (That its steps are not
/// checked one by one is tested in `robert_clip::editor`.)
#[test]
fn a_journal_of_ten_thousand_edits_is_read_once() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.clip.json");
    std::fs::write(&path, blank().to_text()).unwrap();
    let mut doc = Document::open(&path, dir.path(), |_| None).unwrap();
    let records: Vec<Record> = (0..10_000)
        .map(|n: u32| {
            let keys_put = vec![Key::new(1 + n * 7 % 97, &[f64::from(n) / 1e4, 0.5])];
            let patch = match n % 3 {
                0 => Delta { name: Some(format!("n{n}")), ..Delta::default() },
                _ => Delta { keys_put, ..Delta::default() },
            };
            Record::Edit { label: "Edit".to_owned(), patch: Box::new(patch) }
        })
        .collect();
    doc.journal.append(&records).unwrap();
    let journal = doc.journal.bytes();
    assert!(journal > 800_000, "{journal} bytes");
    drop(doc);
    let before = moved_bytes();
    let doc = Document::open(&path, dir.path(), |_| None).unwrap();
    let [read, written] = moved_bytes();
    assert_eq!((doc.history(), doc.clip().keys.len()), ((10_000, 10_000), 98));
    assert_eq!((doc.clip().name.as_str(), doc.restored().unwrap().edits), ("n9999", 10_000));
    let journal = journal + (64 << 10);
    assert!(read - before[0] < 2 * journal, "{} bytes read of {journal}", read - before[0]);
    // Older steps of the history go into a file of their own.
    assert!(written - before[1] < 3 * journal, "{} bytes written", written - before[1]);
}

#[test]
fn a_refused_edit_leaves_no_record() {
    let dir = tempfile::tempdir().unwrap();
    let mut doc = Document::new(blank(), dir.path(), None).unwrap();
    let before = doc.journal.bytes();
    let answers = doc.edit(&[add(5000), Edit::Redo]);
    assert!(answers[0].is_err() && answers[1].as_ref().unwrap().is_empty());
    assert_eq!(doc.journal.bytes(), before);
}

#[test]
fn one_damaged_record_costs_one_edit_and_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.clip.json");
    let journal = dir.path().join("a.clip.json.autosave");
    std::fs::write(&path, blank().to_text()).unwrap();
    let open = || Document::open(&path, dir.path(), |_| None).unwrap();
    let mut doc = open();
    for frame in 10..60 {
        doc.edit(&[add(frame)]);
    }
    doc.edit(&[Edit::Undo]);
    let whole = doc.clip().clone();
    drop(doc);
    let good = std::fs::read(&journal).unwrap();
    // A byte in each record, and in the base: hundreds of positions from end to end.
    for at in (0..good.len()).step_by(61) {
        let mut bad = good.clone();
        bad[at] ^= 0x20;
        std::fs::write(&journal, &bad).unwrap();
        let mut doc = open();
        let missing = whole.keys.iter().filter(|k| doc.clip().key(k.frame) != Some(*k)).count();
        let extra = doc.clip().keys.len() + missing - whole.keys.len();
        assert!(missing + extra <= 1, "byte {at}: {missing} missing, {extra} extra");
        let told = doc.restored().unwrap().clone();
        assert!(!told.lost.is_empty() || told.torn_bytes > 0, "byte {at}");
        assert_eq!(std::fs::read(told.kept.unwrap()).unwrap(), bad, "byte {at}");
        // It goes on from there, and comes back once more without a word.
        doc.edit(&[add(90)]);
        let clip = doc.clip().clone();
        drop(doc);
        let mut doc = open();
        assert_eq!(doc.clip(), &clip, "byte {at}");
        assert!(doc.restored().unwrap().lost.is_empty());
        while !doc.edit(&[Edit::Undo])[0].as_ref().unwrap().is_empty() {}
        assert_eq!(doc.clip(), &blank(), "byte {at}");
        drop(doc);
        for kept in std::fs::read_dir(dir.path()).unwrap() {
            let kept = kept.unwrap().path();
            if kept.to_string_lossy().contains(".damaged") {
                std::fs::remove_file(kept).unwrap();
            }
        }
    }
}

#[test]
fn a_damaged_draft_is_neither_emptied_nor_lost() {
    let dir = tempfile::tempdir().unwrap();
    let mut doc = Document::new(blank(), dir.path(), None).unwrap();
    doc.edit(&[add(20), add(40)]);
    drop(doc);
    let path = dir.path().join("untitled-1.autosave");
    let good = std::fs::read(&path).unwrap();
    let mut bad = good.clone();
    bad[60] ^= 1;
    std::fs::write(&path, &bad).unwrap();
    assert_eq!(Document::drafts(dir.path()).len(), 1);
    assert_eq!(std::fs::read(&path).unwrap(), bad, "a look changes nothing");
    let doc = Document::draft(dir.path(), 1, |_| None).unwrap();
    assert_eq!(doc.clip().keys.len(), 3);
    assert_eq!(doc.restored().unwrap().lost.len(), 1);
    drop(doc);
    // With both copies of the base gone there is no clip, yet the file stays.
    let mut bad = good.clone();
    let second = bad.len() / 2;
    bad[60..second].fill(b'x');
    std::fs::write(&path, &bad).unwrap();
    let other = Document::new(blank(), dir.path(), None).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), bad);
    drop(other);
}

#[test]
fn a_journal_that_makes_no_sense_does_not_lock_the_clip_up() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.clip.json");
    let at = dir.path().join("a.clip.json.autosave");
    std::fs::write(&path, blank().to_text()).unwrap();
    let edit = Record::Edit { label: "x".into(), patch: Box::default() };
    let (mut journal, ..) = Journal::open(&at).unwrap();
    journal.append(&[Record::Base { text: "{".into(), path: None }, edit]).unwrap();
    drop(journal);
    let doc = Document::open(&path, dir.path(), |_| None).unwrap();
    assert_eq!(doc.clip(), &blank());
    let told = doc.restored().unwrap();
    assert!(told.lost[0].contains("is no clip") && told.kept.is_some(), "{told:?}");
}

#[test]
fn a_draft_from_before_1970_is_found() {
    let dir = tempfile::tempdir().unwrap();
    let mut doc = Document::new(blank(), dir.path(), None).unwrap();
    doc.edit(&[add(20)]);
    doc.close();
    let file = std::fs::File::options().write(true).open(dir.path().join("untitled-1.autosave"));
    let long_ago = std::time::UNIX_EPOCH - std::time::Duration::from_hours(24);
    file.unwrap().set_modified(long_ago).unwrap();
    assert_eq!(Document::drafts(dir.path()).len(), 1);
}

#[test]
fn what_another_program_wrote_is_neither_overwritten_nor_lost() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.clip.json");
    std::fs::write(&path, blank().to_text()).unwrap();
    let mut doc = Document::open(&path, dir.path(), |_| None).unwrap();
    doc.edit(&[add(20)]);
    let mut other = blank();
    other.keys.push(Key::new(70, &[0.1, 0.2]));
    std::fs::write(&path, other.to_text()).unwrap();
    assert!(matches!(doc.save(None, false, dir.path()), Err(Error::Changed { .. })));
    assert_eq!(std::fs::read_to_string(&path).unwrap(), other.to_text());
    // Under another name nothing is in the way.
    let copy = dir.path().join("b.clip.json");
    let mut second = Document::open(&copy, dir.path(), |_| None);
    assert!(second.is_err());
    // Read again: what was here can be brought back by undo.
    assert_eq!(doc.reload().unwrap().len(), 1);
    assert!(doc.clip() == &other && !doc.is_dirty() && doc.text() == other.to_text());
    doc.edit(&[Edit::Undo]);
    assert!(doc.clip().key(20).is_some() && doc.is_dirty());
    doc.save(None, false, dir.path()).unwrap();
    // Overwritten when that is said.
    std::fs::write(&path, other.to_text()).unwrap();
    doc.save(None, true, dir.path()).unwrap();
    assert_eq!(std::fs::read_to_string(&path).unwrap(), doc.clip().to_text());
    // A file that is gone is written again.
    std::fs::remove_file(&path).unwrap();
    doc.save(None, false, dir.path()).unwrap();
    // After a reload a kill loses nothing.
    std::fs::write(&path, other.to_text()).unwrap();
    doc.reload().unwrap();
    doc.edit(&[add(30)]);
    let clip = doc.clip().clone();
    drop((doc, second));
    second = Document::open(&path, dir.path(), |_| None);
    assert_eq!(second.unwrap().clip(), &clip);
}

/// The files of a clip and its journal on disk.
#[derive(Clone, PartialEq)]
struct Disk {
    clip: Vec<u8>,
    journal: Vec<u8>,
}

impl Disk {
    fn read(dir: &std::path::Path) -> Disk {
        let read = |name| std::fs::read(dir.join(name)).unwrap();
        Disk { clip: read("a.clip.json"), journal: read("a.clip.json.autosave") }
    }

    fn write(&self, dir: &std::path::Path) {
        std::fs::write(dir.join("a.clip.json"), &self.clip).unwrap();
        std::fs::write(dir.join("a.clip.json.autosave"), &self.journal).unwrap();
    }

    /// The states of the disk that a power cut may leave between this state and the next. Files are
    /// replaced whole and in order (`fsio`), the clip first. Appended bytes arrive in sectors of
    /// 512 bytes, in any order, and the file may get its new length before them.
    fn cuts(&self, next: &Disk, rng: &mut Rng) -> Vec<Disk> {
        let mut found = vec![self.clone(), next.clone()];
        if self.clip != next.clip {
            found.push(Disk { clip: next.clip.clone(), journal: self.journal.clone() });
        }
        let old = self.journal.len();
        if !next.journal.starts_with(&self.journal) {
            return found;
        }
        let appended = next.journal.len() - old;
        for n in 0..appended.min(16) {
            let end = if appended <= 16 { n } else { rng.below(appended as u64) as usize };
            let journal = next.journal[..old + end].to_vec();
            found.push(Disk { clip: next.clip.clone(), journal });
        }
        let sectors: Vec<usize> = (old / 512..=next.journal.len() / 512).collect();
        for _ in 0..8 {
            let mut journal = next.journal.clone();
            let lost = 1 + rng.below((1 << sectors.len().min(20)) - 1);
            for (i, sector) in sectors.iter().enumerate() {
                if lost >> i & 1 == 1 {
                    let from = (sector * 512).max(old);
                    let to = ((sector + 1) * 512).min(journal.len());
                    journal[from..to].fill(0);
                }
            }
            found.push(Disk { clip: next.clip.clone(), journal });
        }
        found
    }
}

/// A script of edits, undos and saves; the power fails at any moment of each step. Gives the number
/// of moments.
fn power_fails(seed: u64) -> usize {
    // Not on a disk where there is memory: each moment costs several `fsync`.
    let shm = std::path::Path::new("/dev/shm");
    let folder = if shm.is_dir() { shm.to_owned() } else { std::env::temp_dir() };
    let [here, step_by_step, after] = [(); 3].map(|()| tempfile::tempdir_in(&folder).unwrap());
    let open = |dir: &tempfile::TempDir| {
        Document::open(&dir.path().join("a.clip.json"), dir.path(), |_| None).unwrap()
    };
    for dir in [&here, &step_by_step] {
        std::fs::write(dir.path().join("a.clip.json"), blank().to_text()).unwrap();
    }
    // The same edits one at a time: what a part of several edits leads to.
    let (mut doc, mut single) = (open(&here), open(&step_by_step));
    let mut rng = Rng::new(seed, Stream::Test, 90);
    let mut moments = 0;
    for _ in 0..8 {
        let before = Disk::read(here.path());
        let mut states = vec![doc.clip().clone()];
        if rng.below(5) == 0 {
            doc.save(None, true, here.path()).unwrap();
            single.save(None, true, step_by_step.path()).unwrap();
        } else {
            let edit = |rng: &mut Rng| match rng.below(6) {
                0 => Edit::Undo,
                1 => Edit::Redo,
                2 => {
                    let name = "x".repeat(rng.below(900) as usize);
                    Edit::Op(Box::new(Op::ClipRename(ClipRename { name })))
                }
                _ => add(1 + rng.below(98) as u32),
            };
            let edits: Vec<Edit> = (0..=rng.below(3)).map(|_| edit(&mut rng)).collect();
            for edit in &edits {
                single.edit(std::slice::from_ref(edit));
                states.push(single.clip().clone());
            }
            doc.edit(&edits);
        }
        assert_eq!(doc.clip(), single.clip());
        let done = Disk::read(here.path());
        for cut in before.cuts(&done, &mut rng) {
            for entry in std::fs::read_dir(after.path()).unwrap() {
                std::fs::remove_file(entry.unwrap().path()).unwrap();
            }
            cut.write(after.path());
            let found = open(&after);
            let place = states.iter().rposition(|s| s == found.clip());
            // Of several edits that were written together, and so not acknowledged yet, a sector
            // in the middle may be lost. The edits after it are kept, and the lost one is named.
            let named = found.restored().is_some_and(|r| !r.lost.is_empty());
            assert!(
                place.is_some() || named && states.len() > 2,
                "seed {seed}: neither what was acknowledged nor later, and no loss is named"
            );
            assert!(
                cut != done || place == Some(states.len() - 1),
                "seed {seed}: acknowledged and lost"
            );
            moments += 1;
        }
    }
    moments
}

/// Twelve scripts in a normal run, `ROBERT_SCRIPTS=200` for the long one.
#[test]
fn a_power_cut_at_any_moment_leaves_what_was_acknowledged_or_later() {
    let scripts = std::env::var("ROBERT_SCRIPTS").ok().and_then(|n| n.parse().ok()).unwrap_or(12);
    let moments: usize = (0..scripts).map(power_fails).sum();
    println!("{scripts} scripts, {moments} moments");
    assert!(moments > scripts as usize * 20, "{moments}");
}
