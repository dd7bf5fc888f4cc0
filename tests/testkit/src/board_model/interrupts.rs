//! The step interrupt in virtual time, and a stop that comes at any cycle.

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;

use ferrostep_gcode::Emergency;
use ferrostep_printer::Signals;
use ferrostep_step_player::{NextWords, OutputPorts, StepPlayer, Stepping, UpdateTimer};
use ferrostep_virtual_board::VirtualUpdateTimer;

use super::STEP_QUEUE_SLOTS;
use super::recording::WatchedPort;

/// The step queue of a board whose pins are on one port.
pub(super) type Player<M> = StepPlayer<M, 1, STEP_QUEUE_SLOTS>;

/// The interrupts: that of the step timer at each update, and the actions of the emergency scanner.
pub(super) struct Interrupts<'a, M> {
    player: &'a Player<M>,
    timer: &'a VirtualUpdateTimer,
    port: &'a WatchedPort<'a>,
    next: RefCell<NextWords<1>>,
    signals: Signals,
    /// The commands that are to act, with their cycles, in this order.
    acts: RefCell<VecDeque<(u64, Emergency)>>,
    /// Number of step events when motion was stopped.
    events_at_stop: Cell<Option<u64>>,
}

impl<'a, M: Stepping> Interrupts<'a, M> {
    pub fn new(player: &'a Player<M>, timer: &'a VirtualUpdateTimer, port: &'a WatchedPort<'a>) -> Self {
        Self {
            player,
            timer,
            port,
            next: RefCell::new(NextWords::NONE),
            signals: Signals::new(),
            acts: RefCell::default(),
            events_at_stop: Cell::new(None),
        }
    }

    pub fn now(&self) -> u64 {
        self.timer.now_cycles()
    }

    pub fn port(&self) -> &'a WatchedPort<'a> {
        self.port
    }

    /// Advances time to a cycle, unless it is past.
    pub fn pass_to(&self, cycle: u64) {
        while let Some((at, emergency)) = self.take_due(cycle) {
            self.play_to(at);
            self.act(emergency);
        }
        self.play_to(cycle);
    }

    /// Advances by some cycles.
    pub fn pass(&self, cycles: u64) {
        self.pass_to(self.now() + cycles);
    }

    fn play_to(&self, cycle: u64) {
        loop {
            if self.timer.is_called() {
                self.timer.interrupt(self.player, &mut self.next.borrow_mut(), self.port);
            } else if self.timer.is_masked() || self.timer.next_at() > cycle {
                break;
            } else {
                self.timer.next_update();
            }
        }
        self.timer.pass_to(cycle);
        if self.timer.is_called() {
            self.timer.interrupt(self.player, &mut self.next.borrow_mut(), self.port);
        }
    }

    /// Makes the serial interrupt act on M108, M112 or M410 at a cycle, whatever the tasks do then.
    pub fn act_at(&self, cycle: u64, emergency: Emergency) {
        let mut acts = self.acts.borrow_mut();
        let place = acts.partition_point(|(at, _)| *at <= cycle);
        acts.insert(place, (cycle, emergency));
    }

    /// Takes the first of the commands that act up to a cycle.
    fn take_due(&self, cycle: u64) -> Option<(u64, Emergency)> {
        self.acts.borrow_mut().pop_front_if(|(at, _)| *at <= cycle)
    }

    /// Acts now, as when its bytes arrive.
    pub fn act(&self, emergency: Emergency) {
        match emergency {
            Emergency::EndWait => self.signals.end_wait(),
            Emergency::QuickStop => self.stop(),
            Emergency::Stop => {
                self.signals.halt();
                self.stop();
            }
            Emergency::PromptAnswer(button) => self.signals.answer_prompt(button),
        }
    }

    /// The flags of the interrupts that act on bytes as they arrive.
    pub fn signals(&self) -> &Signals {
        &self.signals
    }

    /// Stops all motors, as the serial interrupt does.
    pub fn stop(&self) {
        self.timer.mask();
        self.player.link().request_stop();
        self.events_at_stop.set(self.events_at_stop.get().or(Some(self.port.port().events())));
    }

    /// Takes the number of step events at the moment of the stop.
    pub fn take_events_at_stop(&self) -> Option<u64> {
        self.events_at_stop.take()
    }

    /// The player looks for the first slot of a motion.
    pub fn start_or_end(&self) {
        self.player.start_or_end(&mut self.next.borrow_mut(), self.timer);
    }

    /// Puts a word on the pins.
    pub fn write(&self, word: u32) {
        self.port.write(0, word);
    }
}
