//! `ferrostep preprocess`.

use std::io::BufWriter;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use ferrostep_gpre::Encoding;
use ferrostep_session::gpre::{self, PrepareError, PreparedSummary};
use ferrostep_session::input;
use ferrostep_session::output::{Accepted, Output, OutputError};

use crate::arguments::{Format, JobArguments};
use crate::job::{open, replies, strict};
use crate::machine;
use crate::outcome::result;
use crate::progress::Progress;
use crate::protected::inputs;
use crate::terminal::tell;

/// Plans the job and writes it as a prepared one.
pub fn run(job: &JobArguments, out: &Path, format: Format) -> Result<ExitCode, String> {
    // A prepared job is for the machine that it names, whose travel no comment changes.
    let named = machine::name_or_path(job.profile.as_deref());
    let (profile, mut input) = open(job, Some(named))?;
    let name = input::name(&job.file);
    if input.is_prepared() {
        return Err(format!("{name}: this is a prepared job already, and preprocess takes G-code"));
    }
    let encoding = match format {
        Format::Compact => Encoding::Compact,
        Format::Wide => Encoding::Wide,
    };
    // The header is written last, at the beginning of the file, which a pipe cannot do.
    let part = Output::create(out, Accepted::File, &inputs(&job.file, named)).map_err(|error| error.to_string())?;
    let mut part = BufWriter::new(part);
    let progress = Progress::new();
    let replies = replies(&progress);
    let started = Instant::now();
    let place = input.place();
    let picture = gpre::take_thumbnail(&mut input).map_err(|error| format!("{name}: cannot be read: {error}"))?;
    let target = gpre::Target { out: &mut part, encoding };
    let prepared = gpre::prepare(&mut input, picture, profile, replies, target, |done, figures| {
        progress.show(place.share(), done, || *figures);
    });
    progress.end();
    let prepared = match prepared {
        Ok(prepared) => prepared,
        Err(PrepareError::Write(error)) => return Err(OutputError::new(out, error).to_string()),
        Err(error @ (PrepareError::Acceleration(_) | PrepareError::FilamentOnTheWay)) => return Err(error.to_string()),
        Err(error @ (PrepareError::Job(_) | PrepareError::Command(..))) => {
            tell(format_args!("error: {name}: {error}"));
            return Ok(ExitCode::from(1));
        }
    };
    let part = part.into_inner().map_err(|error| OutputError::new(out, error.into_error()).to_string())?;
    part.keep().map_err(|error| error.to_string())?;
    let wall_s = started.elapsed().as_secs_f64();
    let summary = PreparedSummary::new(&job.file, out, profile.name, &prepared, wall_s);
    let code = result(job.json.then_some(&summary), || format!("{summary}\n"));
    Ok(if job.strict && code == ExitCode::SUCCESS { strict(&job.file, &summary.remarks) } else { code })
}
