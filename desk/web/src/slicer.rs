//! Implements the part of OctoPrint's interface that slicers use to send a file: the paths below
//! `/api/` and OctoPrint's words for a printer's state.

use std::fmt::Write;
use std::net::TcpStream;

use serde_json::{Value, json};

use crate::answer::Answer;
use crate::form;
use crate::printer::{Activity, Printer, State};
use crate::request::Request;
use crate::routes::{Room, body, length, refused};

/// Version of OctoPrint's interface that the paths follow.
const API_VERSION: &str = "0.1";

/// Version of this server, reported where OctoPrint gives its own.
const VERSION: &str = env!("CARGO_PKG_VERSION");

impl<P: Printer> Room<P> {
    /// Answers a slicer's request. `path` is the part after `/api/`.
    ///
    /// # Errors
    /// The answer that refuses the request.
    pub fn slicer(&self, request: &Request, path: &str, stream: &TcpStream) -> Result<Answer, Answer> {
        self.may_send(request, stream)?;
        match (request.method.as_str(), path) {
            ("GET", "version") => {
                // Slicers recognise the interface by the start of this text.
                answer(
                    &json!({"api": API_VERSION, "server": VERSION, "text": format!("OctoPrint (Ferrostep {VERSION})")}),
                )
            }
            ("GET", "server") => answer(&json!({"version": VERSION, "safemode": null})),
            ("GET", "settings") => answer(&settings(&self.printer.state())),
            ("GET", "printer") => match self.printer.state() {
                State { activity: Activity::Disconnected, message, .. } => {
                    Err(Answer::text(409, message.unwrap_or_else(|| "the printer is not connected".to_owned())))
                }
                state => answer(&printer(&state)),
            },
            ("GET", "job") => answer(&job(&self.printer.state())),
            ("POST", "files/local") => self.form(request, stream),
            (_, "version" | "server" | "settings" | "printer" | "job") => {
                Err(Answer::text(405, "this is only read (GET): the page starts, pauses and cancels a print"))
            }
            (_, "files/local") => Err(Answer::text(405, "a file is only sent (POST): the page shows it")),
            _ => Err(Answer::text(
                404,
                "of OctoPrint's interface there are here version, server, settings, printer, job and files/local",
            )),
        }
    }

    /// Checks the key in `X-Api-Key` or after `Bearer`. If no key has been chosen, slicers on this
    /// computer need none.
    fn may_send(&self, request: &Request, stream: &TcpStream) -> Result<(), Answer> {
        let is_here = stream.peer_addr().is_ok_and(|peer| peer.ip().to_canonical().is_loopback());
        let sent = request.key.as_deref().or(request.token.as_deref()).filter(|key| !key.is_empty());
        let is_good = |sent: &str| {
            // Always compare both, whatever the first comparison says.
            self.token.is(sent.as_bytes()) | self.key.as_ref().is_some_and(|key| key.is(sent.as_bytes()))
        };
        let why = match (sent, &self.key) {
            (Some(sent), _) if is_good(sent) => return Ok(()),
            (None, None) if is_here => return Ok(()),
            (Some(_), Some(_)) => "the key is wrong: give the slicer that of `ferrostep serve --key`",
            (None, Some(_)) => "the key is missing: give the slicer that of `ferrostep serve --key`",
            (Some(_), None) => {
                "there is no such key: start `ferrostep serve` with --key KEY, or leave the slicer's key empty on this computer"
            }
            (None, None) => {
                "another computer needs a key: start `ferrostep serve` with --key KEY, and give it to the slicer"
            }
        };
        Err(Answer::text(403, why))
    }

    /// Receives a form with a file, and starts to print it if the form says so.
    fn form(&self, request: &Request, stream: &TcpStream) -> Result<Answer, Answer> {
        let length = length(request, self.limits.upload_bytes, "an upload")?;
        let _alone = self.begin_upload()?;
        let body = body(request, stream, length, self.limits.upload)?;
        let form = form::receive(body, request.content_type.as_deref())?;
        let (name, bytes) = (form.upload.name.clone(), form.upload.bytes);
        refused(self.printer.upload(form.upload))?;
        if form.prints {
            let started = self.printer.start();
            started
                .map_err(|why| Answer::text(409, format!("{name} is here, and its print was not started: {why}")))?;
        }
        let host = request.host.as_deref().unwrap_or_default();
        let resource = format!("http://{host}/api/files/local/{}", encoded(&name));
        let made = json!({
            "done": true,
            "effectiveSelect": true,
            "effectivePrint": form.prints,
            "files": {"local": {
                "name": name,
                "display": name,
                "path": name,
                "origin": "local",
                "type": "machinecode",
                "typePath": ["machinecode", "gcode"],
                "size": bytes,
                "refs": {"resource": resource},
            }},
        });
        Ok(Answer::created(made.to_string().into_bytes(), resource))
    }
}

fn answer(value: &Value) -> Result<Answer, Answer> {
    Ok(Answer::json(value.to_string().into_bytes()))
}

/// Percent-encodes a name for a URL.
fn encoded(name: &str) -> String {
    let mut text = String::new();
    for byte in name.bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' => text.push(char::from(byte)),
            // Writing to a string cannot fail.
            _ => drop(write!(text, "%{byte:02X}")),
        }
    }
    text
}

/// Returns OctoPrint's words for an activity.
const fn words(activity: Activity) -> &'static str {
    match activity {
        Activity::Disconnected => "Offline",
        Activity::Idle | Activity::Working => "Operational",
        Activity::Printing => "Printing",
        Activity::Pausing => "Pausing",
        Activity::Paused => "Paused",
        Activity::Cancelling => "Cancelling",
        Activity::Halted => "Error: the printer is halted",
    }
}

/// Returns the settings that slicers ask for: no card, no camera, nothing to wait for after an
/// upload.
fn settings(state: &State) -> Value {
    json!({
        "api": {"enabled": true, "allowCrossOrigin": false},
        "appearance": {"name": state.machine},
        "feature": {"sdSupport": false},
        "gcodeAnalysis": {"runAt": "always"},
        "plugins": {},
        "webcam": {"webcamEnabled": false},
    })
}

fn printer(state: &State) -> Value {
    let heater = |actual: f64, target: f64| json!({"actual": actual, "target": target, "offset": 0});
    let mut temperature = json!({});
    if let Some(heat) = &state.heat {
        temperature = json!({
            "tool0": heater(heat.nozzle_celsius, heat.nozzle_target_celsius),
            "bed": heater(heat.bed_celsius, heat.bed_target_celsius),
        });
        if let (Some(actual), Some(target)) = (heat.chamber_celsius, heat.chamber_target_celsius) {
            temperature["chamber"] = heater(actual, target);
        }
    }
    let activity = state.activity;
    let has_failed = matches!(activity, Activity::Halted);
    json!({
        "temperature": temperature,
        "sd": {"ready": false},
        "state": {
            "text": words(activity),
            "flags": {
                "operational": !has_failed,
                "ready": activity == Activity::Idle && state.owner.is_none(),
                "printing": activity == Activity::Printing,
                "pausing": activity == Activity::Pausing,
                "paused": activity == Activity::Paused,
                "cancelling": activity == Activity::Cancelling,
                "resuming": false,
                "finishing": false,
                "sdReady": false,
                "error": has_failed,
                "closedOrError": has_failed,
            },
        },
    })
}

fn job(state: &State) -> Value {
    let job = state.job.as_ref();
    // The whole time is known only until the file starts to print.
    let whole_s = job.and_then(|job| job.remaining_s.filter(|_| job.line == 0));
    json!({
        "job": {
            "file": {
                "name": job.map(|job| &job.name),
                "display": job.map(|job| &job.name),
                "path": job.map(|job| &job.name),
                "origin": job.map(|_| "local"),
                "size": job.map(|job| job.bytes),
                "date": null,
            },
            "estimatedPrintTime": whole_s,
            "lastPrintTime": null,
            "filament": null,
            "user": null,
        },
        "progress": {
            "completion": job.map(|job| job.share * 100.0),
            "filepos": null,
            "printTime": null,
            "printTimeLeft": job.and_then(|job| job.remaining_s).map(f64::round),
        },
        "state": words(state.activity),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::printer::{Heat, Job};

    fn state(activity: Activity) -> State {
        State {
            machine: "Virtual printer".to_owned(),
            activity,
            owner: None,
            heat: Some(Heat { nozzle_celsius: 200.5, nozzle_target_celsius: 210.0, ..Heat::default() }),
            position_mm: None,
            job: Some(Job { name: "a.gcode".to_owned(), bytes: 7, line: 3, share: 0.25, remaining_s: Some(61.4) }),
            message: None,
        }
    }

    #[test]
    fn each_state_has_one_flag_that_slicers_act_on() {
        let flags = ["printing", "pausing", "paused", "cancelling", "error"];
        for (activity, flag) in [
            (Activity::Printing, Some("printing")),
            (Activity::Pausing, Some("pausing")),
            (Activity::Paused, Some("paused")),
            (Activity::Cancelling, Some("cancelling")),
            (Activity::Halted, Some("error")),
            (Activity::Idle, None),
            (Activity::Working, None),
        ] {
            let shown = printer(&state(activity));
            for name in flags {
                assert_eq!(shown["state"]["flags"][name], json!(Some(name) == flag), "{activity:?} {name}");
            }
            assert_eq!(shown["state"]["flags"]["ready"], json!(activity == Activity::Idle), "{activity:?}");
        }
        let shown = printer(&state(Activity::Idle));
        assert_eq!(shown["temperature"]["tool0"], json!({"actual": 200.5, "target": 210.0, "offset": 0}));
        assert!(shown["temperature"]["chamber"].is_null());
    }

    #[test]
    fn a_job_has_its_share_and_the_time_left() {
        let shown = job(&state(Activity::Printing));
        assert_eq!(
            (&shown["progress"]["completion"], &shown["progress"]["printTimeLeft"]),
            (&json!(25.0), &json!(61.0))
        );
        assert_eq!((&shown["job"]["file"]["name"], &shown["state"]), (&json!("a.gcode"), &json!("Printing")));
        let none = job(&State { job: None, ..state(Activity::Idle) });
        assert!(none["job"]["file"]["name"].is_null() && none["progress"]["completion"].is_null());
    }

    #[test]
    fn names_are_encoded_within_an_address() {
        assert_eq!(encoded("Würfel 1.gcode"), "W%C3%BCrfel%201.gcode");
        assert_eq!(encoded("a\r\nb%"), "a%0D%0Ab%25");
    }
}
