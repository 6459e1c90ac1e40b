//! `sim-host export`: a scenario as a file of other tools.

use super::arguments::{ExportArgs, Exported};
use super::{Exit, Failure};
use crate::export::{dbc, graphml};
use crate::record::{is_standard_output, write_atomic};
use crate::run::{files_named_in, is_one_file};
use crate::scenario::AnyScenario;
use std::io::{self, Write};
use std::path::Path;

pub(super) fn export_command(args: &ExportArgs) -> Result<Exit, Failure> {
    let scenario = &args.source.scenario;
    let named = (scenario.clone(), format!("the scenario {}", scenario.display()));
    let read = files_named_in(scenario, &args.source.settings.set).into_iter();
    let read = read.map(|path| (path.clone(), format!("{}, a file that the scenario reads", path.display())));
    for (path, what) in std::iter::once(named).chain(read) {
        if let Some(out) = args.out.as_deref().filter(|out| is_one_file(out, &path)) {
            return Err(Failure::bad_input(format!(
                "--out {} is {what}, which must not be overwritten; name another file",
                out.display()
            )));
        }
    }
    let bytes = match args.what {
        Exported::Dbc => {
            let loaded = args.source.settings.load(scenario)?;
            dbc(&loaded).map_err(|why| Failure::bad_input(format!("{}: {why}", scenario.display())))?
        }
        Exported::Graphml => match args.source.load_any()? {
            AnyScenario::Wired(scenario) => graphml(&scenario.graph),
            AnyScenario::Large(scenario) => graphml(&scenario.graph),
        }
        .into_bytes(),
    };
    write(args.out.as_deref(), &bytes)
}

fn write(out: Option<&Path>, bytes: &[u8]) -> Result<Exit, Failure> {
    match out.filter(|out| !is_standard_output(out)) {
        Some(out) => write_atomic(out, bytes).map_err(|error| Failure::bad_input(error.to_string()))?,
        None => {
            let mut to = io::stdout().lock();
            to.write_all(bytes).and_then(|()| to.flush())?;
        }
    }
    Ok(Exit::Success)
}
