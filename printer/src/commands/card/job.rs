//! A print of a prepared job from the card.

use ferrostep_gpre::ReadError;
use ferrostep_gpre::compact::Frame;
use ferrostep_gpre::parts::{Part, Parts};

use super::print::{Bytes, End, HostLines};
use crate::commands::transfer::{Place, Stop};
use crate::error::Failure;
use crate::ports::{Motion, Ports, Replies};
use crate::printer::Printer;

/// Reason why a job ends early.
enum JobEnd {
    Stop(Stop),
    End(End),
}

impl From<ReadError> for JobEnd {
    fn from(error: ReadError) -> Self {
        Self::Stop(Stop::Read(error))
    }
}

impl<P: Ports> Printer<'_, P> {
    /// Prints the job from its beginning.
    pub(super) async fn print_job(&mut self, hosts: &mut impl HostLines, room: &mut [u8], stops: u32) -> End {
        if self.print.card.position != 0 {
            self.replies.say(format_args!("echo:card: a prepared job is printed from its beginning only"));
            return End::Stopped;
        }
        if let Err(error) = self.needs_profiles_steps() {
            self.replies.refuse(self.lines.number, &Failure::Command(error));
            return End::Stopped;
        }
        self.interpreter.modal.in_prepared_job = true;
        self.motion.set_bounded_in_time(false);
        let played = self.play_job(hosts, room, stops).await;
        self.interpreter.modal.in_prepared_job = false;
        let end = match played {
            Ok(()) => return End::Complete,
            Err(JobEnd::End(end)) => end,
            Err(JobEnd::Stop(stop)) => {
                hosts.tell_all();
                self.replies.say(format_args!("echo:gpre: {stop}"));
                End::Stopped
            }
        };
        // The remaining accepted moves are executed, to a standstill on the path.
        let _ = self.abandon_prepared().await;
        end
    }

    async fn play_job(&mut self, hosts: &mut impl HostLines, room: &mut [u8], stops: u32) -> Result<(), JobEnd> {
        let mut parts = Parts::new();
        let (mut filled, mut is_complete) = (0, false);
        loop {
            let used = match parts.next(room.get(..filled).unwrap_or_default(), is_complete)? {
                Part::End => return Ok(()),
                Part::More => {
                    let rest = room.get_mut(filled..).unwrap_or_default();
                    match self.take_bytes(hosts, rest, stops).await.map_err(JobEnd::End)? {
                        Bytes::Some(length) => filled += length,
                        Bytes::End => is_complete = true,
                    }
                    0
                }
                Part::Passed(length) => length,
                Part::Header(length, header) => {
                    self.begin_prepared(&header).await.map_err(JobEnd::Stop)?;
                    length
                }
                Part::Frame { length, number, offset } => {
                    let fault = |fault| JobEnd::from(ReadError { fault, offset, frame: Some(number) });
                    let frame = room.get(..length).unwrap_or_default();
                    let mut items = Frame::read(frame, offset, Some(number))?.items().map_err(fault)?;
                    let mut place = Place::new(*items.start(), number, offset);
                    loop {
                        self.answer_hosts(hosts, stops).await.map_err(JobEnd::End)?;
                        if !self.item(&mut items, &mut place).await.map_err(JobEnd::Stop)? {
                            break;
                        }
                    }
                    length
                }
            };
            self.print.card.position = self.print.card.position.saturating_add(used as u32);
            self.note_card_progress();
            room.copy_within(used..filled, 0);
            filled -= used;
        }
    }
}
