//! Opens documents in the session.

use std::path::Path;
use std::time::Duration;

use super::actor::{Asked, SessionActor, reference};
use crate::document::Document;
use crate::protocol::{DocumentView, Error, RobotFacts};
use crate::simulation::worker::{DescribeRobot, LoadRobot};
use crate::workspace::robot_folders;
use robert_clip as clip;
use robert_clip::{Clip, JointTable};
use robert_robot::MODEL_FILE;

/// The time that opening waits for the facts of its robot.
const ROBOT_PATIENCE: Duration = Duration::from_secs(20);

/// The joint table of the answer, if there is one.
fn table(asked: &Asked) -> Option<JointTable> {
    asked.as_ref().ok().map(|facts| facts.table.clone())
}

impl SessionActor {
    pub(crate) fn open(&mut self, path: &Path) -> Result<DocumentView, Error> {
        // The same file is opened again: its lock is released first, but the document stays open if
        // opening fails.
        let again = std::path::absolute(path).ok();
        if self.document.as_ref().is_some_and(|d| d.path() == again.as_deref()) {
            return Ok(self.view());
        }
        let mut asked = None;
        let document = Document::open(path, &self.workspace.state_dir, |clip| {
            table(asked.insert(self.ask_robot(clip)))
        })?;
        Ok(self.take_up(document, asked))
    }

    pub(crate) fn recover(&mut self) -> bool {
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
        let Some(mut document) = found else { return false };
        // If this document caused the end of that studio, the next start does not open it.
        document.put_aside();
        self.take_up(document, asked);
        if let Some(document) = &mut self.document {
            document.taken_up();
        }
        true
    }

    pub(crate) fn take_up_draft(&mut self, number: u32) -> Result<DocumentView, Error> {
        let mut asked = None;
        let document = Document::draft(&self.workspace.state_dir, number, |clip| {
            table(asked.insert(self.ask_robot(clip)))
        })?;
        Ok(self.take_up(document, asked))
    }

    pub(crate) fn start_from(&mut self, clip: Clip) -> Result<DocumentView, Error> {
        let asked = self.ask_robot(&clip);
        let document = Document::new(clip, &self.workspace.state_dir, table(&asked))?;
        Ok(self.take_up(document, Some(asked)))
    }

    /// Asks for the facts about a robot and remembers its source.
    pub(crate) fn know(&mut self, robot: &str) -> Result<RobotFacts, Error> {
        let question = DescribeRobot { robot: robot.to_owned() };
        let facts = self.simulation.ask_blocking(question, ROBOT_PATIENCE)?;
        self.sources.insert(facts.id.clone(), robot.to_owned());
        Ok(facts)
    }

    /// Asks the worker to load a clip's robot: by its id, or from the folder that the user named,
    /// that the clip names, or that an import made in the studio's folder.
    pub(crate) fn ask_robot(&self, clip: &Clip) -> Result<RobotFacts, Error> {
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

    pub(crate) fn blank(
        &mut self,
        robot: &str,
        length: u32,
        name: String,
    ) -> Result<DocumentView, Error> {
        let facts = self.know(robot)?;
        let table = &facts.table;
        let mut clip =
            Clip::new(reference(table), length.clamp(2, robert_base::limits::CLIP_FRAMES));
        clip.name = name;
        // The robot starts at the first key unless the clip gives another start.
        let rest: Vec<f64> = table.rest.iter().map(|v| clip::round(*v)).collect();
        clip.keys.push(clip::Key::new(0, &rest));
        self.start_from(clip)
    }
}
