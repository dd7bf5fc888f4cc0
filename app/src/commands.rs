//! The printer task's work: from lines to commands, and from commands to moves and replies.

use core::cell::RefCell;

use ferrostep_printer::{Printer, SharedMotion, Signals};
use ferrostep_stm32f4_board::identifier::identifier;
use ferrostep_stm32f4_board::measured::Switch;
use rtic::Mutex;

#[cfg(accelerometer)]
use crate::accelerometer::BoardAccelerometer;
use crate::accelerometer::BoardRecorder;
use crate::black_box::{BoardBlackBox, Records};
use crate::card::BoardMailbox;
#[cfg(card)]
use crate::card::{BoardMailboxLock, CardHosts};
use crate::clock::SystemClock;
use crate::drivers::BoardDriverBank;
#[cfg(drivers)]
use crate::drivers::BoardDrivers;
use crate::heat::{EQUIPMENT, Heat};
use crate::host_line::{Reader, Writers};
use crate::identity::IDENTITY;
use crate::job_line::{Hosts, JOB_BYTES, JobPort};
use crate::ports::{BoardHeating, BoardMachine, BoardMachineLock, BoardReplies};
use crate::profile::PROFILE;
#[cfg(settings_memory)]
use crate::settings_memory;
use crate::timing::BoardTiming;

/// Resources that the printer task shares with others.
pub struct Shared<M, H, W, D, A, R, B> {
    /// The machine, shared with the planner task.
    pub machine: M,
    /// The heaters, shared with their control.
    pub heat: H,
    /// The hosts' lines, shared with all tasks that report.
    pub writers: W,
    /// The motor drivers, shared with the task that supervises them.
    pub drivers: D,
    /// The accelerometer's recorder, shared with the task that takes its samples.
    pub recorder: A,
    /// The black box's records, shared with the tasks that write them.
    pub records: R,
    /// Mailbox to the card's task; `None` if the board has no slot, or no clock for it.
    pub mailbox: Option<B>,
}

/// Resources that only the printer task uses.
pub struct Own<'a> {
    /// Source of the hosts' bytes.
    pub reader: &'a mut Reader,
    /// Switch of the time measurement (M798).
    pub measured: &'a mut Switch,
    /// Buffer for a job's bytes.
    pub job: &'a mut [u8; JOB_BYTES],
}

/// Executes the hosts' commands, and prints from the card.
pub async fn execute<M, H, W, D, A, R, B>(
    shared: Shared<M, H, W, D, A, R, B>,
    own: Own<'_>,
    signals: &'static Signals,
) -> !
where
    M: Mutex<T = &'static mut BoardMachine>,
    H: Mutex<T = Heat>,
    W: Mutex<T = Writers>,
    D: Mutex<T = BoardDriverBank>,
    A: Mutex<T = BoardRecorder>,
    R: Mutex<T = Records>,
    B: Mutex<T = BoardMailbox>,
{
    let Shared { machine, heat, writers, drivers, recorder, records, mailbox } = shared;
    let motion = SharedMotion::new(BoardMachineLock::new(machine, signals));
    let heating = BoardHeating(RefCell::new(heat));
    let replies = BoardReplies::new(writers);
    let mut printer =
        Printer::<(_, _, _, _)>::new(&PROFILE, motion, heating, SystemClock::default(), &replies, signals);
    printer.set_version(IDENTITY.version());
    printer.set_identifier(identifier());
    printer.set_emergency_parser(true);
    printer.set_meatpack(true);
    printer.set_equipment(EQUIPMENT);
    #[cfg(drivers)]
    let drivers = BoardDrivers(RefCell::new(drivers));
    #[cfg(drivers)]
    printer.set_drivers(&drivers);
    #[cfg(not(drivers))]
    let _no_drivers = drivers;
    #[cfg(accelerometer)]
    let accelerometer = BoardAccelerometer::new(recorder, &replies, own.reader.clock());
    #[cfg(accelerometer)]
    printer.set_accelerometer(&accelerometer);
    #[cfg(not(accelerometer))]
    let _no_accelerometer = recorder;
    let black_box = BoardBlackBox::new(records);
    printer.set_black_box(&black_box);
    let timing = BoardTiming::new(own.measured);
    printer.set_timing(&timing);
    printer.set_receives_jobs();
    #[cfg(settings_memory)]
    {
        printer.set_settings_memory(&settings_memory::MEMORY);
        printer.restore_settings();
    }
    #[cfg(card)]
    let mailbox = mailbox.map(|mailbox| BoardMailboxLock(RefCell::new(mailbox)));
    #[cfg(card)]
    if let Some(mailbox) = &mailbox {
        printer.set_card(mailbox);
        printer.mount_card().await;
    }
    #[cfg(not(card))]
    let _no_slot = mailbox;
    let mut hosts = Hosts::new();
    let mut buffer = [0; 64];
    loop {
        let (port, mut bytes) = own.reader.read(&mut buffer).await;
        replies.answer(port);
        while !bytes.is_empty() {
            let (used, heard) = hosts.feed(port, bytes, &replies);
            bytes = bytes.get(used..).unwrap_or_default();
            let Some((host, line)) = heard else { continue };
            host.answer(&mut printer, line).await;
            if black_box.take_wanted() {
                // A halted machine does not move.
                let _ = printer.finish().await;
                black_box.send_to(&replies).await;
            }
            if let Some(request) = printer.take_job_request() {
                // The host that asks waits for the answer, and then resends the lines that followed
                // the question.
                let mut line = JobPort::new(own.reader, port, &mut hosts, &replies);
                let ended = printer.receive_job(request, &mut line, own.job).await;
                hosts.job_ended(port, ended);
                replies.answer(port);
                break;
            }
        }
        #[cfg(card)]
        if printer.prints_from_card() {
            let mut lines = CardHosts::new(own.reader, &mut hosts, &replies);
            printer.print_from_card(&mut lines, own.job).await;
        }
    }
}
