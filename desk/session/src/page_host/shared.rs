//! The state that the page's requests and the conversation with the printer share.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use ferrostep_host::printer_line::LineOutput;
use ferrostep_host::send::{HALTED, is_transfer_error};
use ferrostep_printer::Profile;
use ferrostep_web::{Console, Heat, Speaker};
use tempfile::NamedTempFile;

use super::readings::{self, Readings};
use crate::schedule::Schedule;
use crate::serve::Ownership;

/// Settings of a page's host.
#[derive(Clone, Debug)]
pub struct Setup {
    /// The machine and its place, for a person.
    pub machine: String,
    /// The machine that times are estimated for.
    pub profile: Profile,
    /// Source of temperatures and position.
    pub readings: Readings,
    /// The other host's place, for a person, where there is one.
    pub outside: Option<String>,
}

/// State of the host and its job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Phase {
    Disconnected,
    Idle,
    Printing,
    Pausing,
    Paused,
    Cancelling,
}

impl Phase {
    /// Returns true while a job is under way.
    pub(super) const fn is_job(self) -> bool {
        matches!(self, Self::Printing | Self::Pausing | Self::Paused | Self::Cancelling)
    }
}

/// The uploaded file.
pub(super) struct PageJob {
    pub name: String,
    pub bytes: u64,
    pub file: Arc<NamedTempFile>,
    pub schedule: Option<Schedule>,
    /// Number of its lines, counted where there is no schedule.
    pub lines: Option<u32>,
    /// Stops the estimate, as its result is not used.
    pub unwanted: Arc<AtomicBool>,
    /// Line of the file up to which commands were answered.
    pub line: u32,
    /// Minutes left by the slicer (M73 R).
    pub slicer_left_s: Option<f64>,
}

impl Drop for PageJob {
    fn drop(&mut self) {
        self.unwanted.store(true, Ordering::Relaxed);
    }
}

/// Wishes of persons that the conversation has not fulfilled yet.
#[derive(Default)]
pub(super) struct Wishes {
    pub start: bool,
    pub end: bool,
    pub pause: bool,
    pub wait_ended: bool,
}

/// State of the host, and the wishes of its pages.
pub(super) struct Inner {
    pub console: Console,
    pub phase: Phase,
    pub is_halted: bool,
    /// A person's lines that wait for their turn.
    pub waiting: VecDeque<String>,
    /// Time since which a line has had no answer, and true if it is a person's line.
    pub owed: Option<(Instant, bool)>,
    pub wishes: Wishes,
    pub job: Option<PageJob>,
    pub heat: Option<Heat>,
    pub position_mm: Option<[f64; 3]>,
    pub message: Option<String>,
    pub output: Option<LineOutput>,
    /// Time of the last question for the position.
    pub asked_position: Option<Instant>,
}

/// The host that serves a page.
pub struct PageHost {
    pub(super) setup: Setup,
    pub(super) ownership: Arc<Ownership>,
    inner: Mutex<Inner>,
}

impl PageHost {
    /// A host that is not connected yet.
    #[must_use]
    pub fn new(setup: Setup) -> Arc<Self> {
        Arc::new(Self {
            setup,
            ownership: Arc::new(Ownership::default()),
            inner: Mutex::new(Inner {
                console: Console::default(),
                phase: Phase::Disconnected,
                is_halted: false,
                waiting: VecDeque::new(),
                owed: None,
                wishes: Wishes::default(),
                job: None,
                heat: None,
                position_mm: None,
                message: None,
                output: None,
                asked_position: None,
            }),
        })
    }

    /// Owner of the printer's line.
    #[must_use]
    pub fn ownership(&self) -> Arc<Ownership> {
        Arc::clone(&self.ownership)
    }

    /// Takes temperatures, position and whether it is halted from a virtual board.
    pub fn tell(&self, heat: Heat, position_mm: [f64; 3], is_halted: bool) {
        let mut inner = self.lock();
        (inner.heat, inner.position_mm, inner.is_halted) = (Some(heat), Some(position_mm), is_halted);
    }

    /// Deletes the uploaded file, before the program ends.
    pub fn forget_job(&self) {
        self.lock().job = None;
    }

    /// Returns the message for a person: how the last job ended, or why the line is not open.
    #[must_use]
    pub fn message(&self) -> Option<String> {
        self.lock().message.clone()
    }

    pub(super) fn lock(&self) -> MutexGuard<'_, Inner> {
        // A thread that panicked leaves a state that can still be used.
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes in a line of the printer.
    pub(super) fn hear(&self, line: &str) {
        let mut inner = self.lock();
        let line = line.trim_end();
        if line.starts_with(HALTED) || line.starts_with("!! the printer is halted") {
            inner.is_halted = true;
        }
        let asks = self.setup.readings == Readings::Asked;
        if let Some(heat) = readings::heat(line) {
            if asks {
                inner.heat = Some(heat);
            }
            let is_asked = matches!(inner.owed, Some((_, true))) && line.starts_with("ok");
            if !is_asked {
                return;
            }
        }
        if asks && let Some(position_mm) = readings::position_mm(line) {
            inner.position_mm = Some(position_mm);
            if inner.asked_position.is_some() && !matches!(inner.owed, Some((_, true))) {
                return;
            }
        }
        // Acknowledgements of a job, signs of life and repeated lines would fill the console.
        let is_routine = line.is_empty()
            || line == "ok" && !matches!(inner.owed, Some((_, true)))
            || line.starts_with("echo:busy:")
            || line.starts_with("Resend:")
            || is_transfer_error(line);
        if !is_routine {
            inner.console.add(Speaker::Printer, line);
        }
    }
}
