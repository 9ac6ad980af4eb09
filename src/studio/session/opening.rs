//! Opens documents in the writer.

use std::path::Path;
use std::time::Duration;

use super::command::{Asked, Reply, Written};
use super::shown::Shown;
use super::writer::Writer;
use crate::document::{Document, is_same_file};
use crate::protocol::{DocumentView, Error, RobotFacts};
use crate::simulation::worker::{DescribeRobot, LoadRobot};
use crate::workspace::robot_folders;
use robert_clip as clip;
use robert_clip::{Clip, JointTable, RobotRef};
use robert_robot::MODEL_FILE;

/// How long the opening of a document waits for the facts about its robot.
const ROBOT_PATIENCE: Duration = Duration::from_secs(20);

/// What is known of the joints then.
fn table(asked: &Asked) -> Option<JointTable> {
    asked.as_ref().ok().map(|facts| facts.table.clone())
}

/// A robot as a clip of it names it.
pub(crate) fn reference(table: &JointTable) -> RobotRef {
    RobotRef {
        id: table.robot.clone(),
        model: None,
        model_sha256: table.model_sha256.clone(),
        joints: table.names(),
        units: table.joints.iter().map(|j| j.unit).collect(),
    }
}

impl Writer {
    pub(super) fn open(&mut self, path: &Path, reply: Reply<DocumentView>) {
        // The same file again: it is open.
        let again = std::path::absolute(path).ok();
        let own = self.document.as_ref().and_then(Document::path);
        if own.zip(again.as_deref()).is_some_and(|(own, again)| is_same_file(own, again)) {
            return self.tell(Written::Same(reply));
        }
        let mut asked = None;
        let document = Document::open(path, &self.workspace.state_dir, |clip| {
            table(asked.insert(self.ask_robot(clip)))
        });
        self.take_up(document, asked, reply);
    }

    pub(super) fn recover(&mut self, reply: Reply<bool>) {
        let mut asked = None;
        let mut ask = |clip: &Clip| table(asked.insert(self.ask_robot(clip)));
        let mut found = Document::orphan(&self.workspace.state_dir, &mut ask);
        for file in self.workspace.recent.list() {
            if found.is_some() {
                break;
            }
            match Document::left_open(file.path.as_ref(), &self.workspace.state_dir, &mut ask) {
                Ok(document) => found = document,
                Err(e) => tracing::warn!("{} is not taken up: {e}", file.path),
            }
        }
        let Some(mut document) = found else {
            reply.send(Ok(false)).ok();
            return;
        };
        // Should it be what ended that studio, the next start does without it.
        document.put_aside();
        let shown = self.put_in_place(document);
        self.tell(Written::Recovered { shown, asked, reply });
    }

    pub(super) fn take_up_draft(&mut self, number: u32, reply: Reply<DocumentView>) {
        let mut asked = None;
        let document = Document::draft(&self.workspace.state_dir, number, |clip| {
            table(asked.insert(self.ask_robot(clip)))
        });
        self.take_up(document, asked, reply);
    }

    pub(super) fn start_from(&mut self, clip: Clip, reply: Reply<DocumentView>) {
        let asked = self.ask_robot(&clip);
        let document = Document::new(clip, &self.workspace.state_dir, table(&asked));
        self.take_up(document, Some(asked), reply);
    }

    /// Opens a document in place of the current one. If there is none to open, the current one
    /// stays open.
    fn take_up(
        &mut self,
        document: Result<Document, Error>,
        asked: Option<Asked>,
        reply: Reply<DocumentView>,
    ) {
        match document {
            Ok(document) => {
                let shown = self.put_in_place(document);
                self.tell(Written::Opened { shown, asked, reply });
            }
            Err(e) => drop(reply.send(Err(e))),
        }
    }

    fn put_in_place(&mut self, document: Document) -> Shown {
        if let Some(path) = document.path() {
            self.workspace.recent.opened(path, document.clip());
        }
        let shown = Shown::of(&document);
        if let Some(old) = self.document.replace(document) {
            old.close();
        }
        shown
    }

    /// Asks about a robot and remembers where it comes from.
    pub(super) fn know(&mut self, robot: &str) -> Result<RobotFacts, Error> {
        let question = DescribeRobot { robot: robot.to_owned() };
        let facts = self.simulation.ask_blocking(question, ROBOT_PATIENCE)?;
        self.sources.insert(facts.id.clone(), robot.to_owned());
        Ok(facts)
    }

    /// Asks the worker to load a clip's robot: by its id, or from the folder that the user or the
    /// clip names, or that an import made in the studio's folder.
    fn ask_robot(&self, clip: &Clip) -> Asked {
        let id = &clip.robot.id;
        let named = clip.robot.model.as_ref().map(|m| self.workspace.folder.join(m));
        let named = named.filter(|dir| dir.join(MODEL_FILE).is_file());
        let robot = match (self.sources.get(id), named) {
            (Some(source), _) => source.clone(),
            (None, Some(dir)) if !robot_folders::is_builtin(id) => dir.display().to_string(),
            _ => robot_folders::source(id, &self.workspace.folder, &self.workspace.state_dir)
                .unwrap_or_else(|| id.clone()),
        };
        self.simulation.ask_blocking(LoadRobot { robot }, ROBOT_PATIENCE)
    }

    pub(super) fn blank(
        &mut self,
        robot: &str,
        length: u32,
        name: String,
        reply: Reply<DocumentView>,
    ) {
        const LONGEST: u32 = robert_base::limits::CLIP_FRAMES;
        if !(2..=LONGEST).contains(&length) {
            let e =
                Error::request(format!("a clip has 2 to {LONGEST} frames of 1/20 s, not {length}"));
            return drop(reply.send(Err(e)));
        }
        let facts = match self.know(robot) {
            Ok(facts) => facts,
            Err(e) => return drop(reply.send(Err(e))),
        };
        let table = &facts.table;
        let mut clip = Clip::new(reference(table), length);
        clip.name = name;
        // The first key is where the robot starts, until somebody says another start.
        let rest: Vec<f64> = table.rest.iter().map(|v| clip::round(*v)).collect();
        clip.keys.push(clip::Key::new(0, &rest));
        self.start_from(clip, reply);
    }
}
