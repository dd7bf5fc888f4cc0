//! One machine with one fault.

use embedded_hal_async::delay::DelayNs;
use ferrostep_hal_shim::FanOutput;
use ferrostep_testkit::host_side::numbered;
use ferrostep_virtual_board::{DriverChip, VirtualDelay};

use super::{At, Fault};
use crate::end_to_end::hosts::{Conversation, Machine};

/// The motor whose driver fails: Y.
const MOTOR: usize = 1;

/// Time that passes until a person looks, s. Faults that let heaters cool are noticed
/// within a minute.
pub const LONG_S: f64 = 300.0;
pub const HOST_IS_GONE_S: f64 = 2100.0;

pub fn now_s(machine: &Machine) -> f64 {
    machine.clock().now_ns() as f64 * 1e-9
}

/// One machine with one fault.
pub struct Trial<'a> {
    pub machine: &'a Machine,
    conversation: Conversation<'a>,
    pub fault: Fault,
    pub said: Vec<String>,
    number: i64,
    /// Time of the fault, s; infinity if it has happened, or is not to happen yet.
    at_s: f64,
    /// Start of the present pause, s.
    paused_s: Option<f64>,
    pauses: u32,
    /// A person mends filament and fan in this pause.
    mended_in: u32,
}

impl<'a> Trial<'a> {
    /// Brings a machine into a state, hot if it must be, just before its command begins; the fault
    /// has not happened.
    pub fn new(machine: &'a Machine, at: At, fault: Fault) -> Self {
        let mut trial = Self {
            machine,
            conversation: Conversation::new(machine),
            fault,
            said: Vec::new(),
            number: 0,
            at_s: f64::INFINITY,
            paused_s: None,
            pauses: 0,
            mended_in: 1 + u32::from(at == At::Paused),
        };
        for line in at.lines_before() {
            trial.say(line);
        }
        trial.said.clear();
        trial
    }

    /// Sets the fault's time, s.
    pub fn fails_at(&mut self, at_s: f64) {
        self.at_s = at_s;
    }

    /// Returns true if the fault has happened.
    pub fn has_failed(&self) -> bool {
        self.at_s == f64::INFINITY
    }

    /// Sends a line of the print. The fault happens when its time has come, and a person
    /// continues a paused print.
    pub fn say(&mut self, line: &str) {
        self.number += 1;
        let text = format!("{}\n", numbered(self.number, line));
        let Self { fault, at_s, paused_s, pauses, mended_in, .. } = self;
        let patience_s = if *fault == Fault::HostGoes { HOST_IS_GONE_S } else { LONG_S };
        let replies = self.conversation.say_while(text.as_bytes(), |machine| {
            happen(machine, *fault, at_s);
            if !machine.signals().is_paused_for_user() {
                *paused_s = None;
                return;
            }
            if paused_s.is_none() {
                *pauses += 1;
            }
            let waited_s = now_s(machine) - *paused_s.get_or_insert_with(|| now_s(machine));
            if waited_s > patience_s && *pauses >= *mended_in {
                machine.set_filament_out(false);
                machine.set_fan_stuck(FanOutput::HotEnd, false);
            }
            if waited_s > patience_s + 2.0 {
                machine.signals().end_wait();
            }
        });
        self.said.extend(replies.iter().flat_map(|reply| reply.lines()).map(str::to_owned));
    }

    /// Advances time without any line from the host.
    pub fn be_silent(&mut self, seconds: f64) {
        let (machine, fault) = (self.machine, self.fault);
        let mut at_s = self.at_s;
        let wait = async {
            for _ in 0..(seconds * 10.0) as u32 {
                VirtualDelay(machine.clock()).delay_ms(100).await;
            }
        };
        machine.run_with(wait, |machine| happen(machine, fault, &mut at_s));
        self.at_s = at_s;
        let replies = machine.replies().take();
        self.said.extend(replies.iter().flat_map(|reply| reply.lines()).map(str::to_owned));
    }

    pub fn count(&self, text: &str) -> usize {
        self.said.iter().filter(|line| line.starts_with(text)).count()
    }
}

/// Causes the fault once its time has come.
fn happen(machine: &Machine, fault: Fault, at_s: &mut f64) {
    if now_s(machine) < *at_s {
        return;
    }
    *at_s = f64::INFINITY;
    match fault {
        Fault::Heater(heater, failure) => machine.set_heater_failure(heater, Some(failure)),
        Fault::FilamentRunsOut => machine.set_filament_out(true),
        Fault::HotEndFanStands => machine.set_fan_stuck(FanOutput::HotEnd, true),
        Fault::HostGoes => {}
        Fault::Driver(flags) => with_chip(machine, |chip| chip.set_flags(flags)),
        Fault::DriverIsSilent => with_chip(machine, |chip| chip.set_silent(true)),
        Fault::EmergencyStop => machine.halt(),
        Fault::SupplyFails => machine.set_supply_failing(true),
        Fault::EndStop(axis, failure) => machine.set_end_stop_failure(axis, Some(failure)),
    }
}

fn with_chip(machine: &Machine, act: impl FnOnce(&mut DriverChip)) {
    machine.drivers().with_lines(|lines| act(lines.chip(MOTOR).unwrap())).unwrap();
}
