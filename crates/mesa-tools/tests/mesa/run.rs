//! Runs of the command, and checks of their results.

use std::process::{Command, Output, Stdio};
use std::time::Duration;

use mesa_hal::transport::udp::UdpConfig;
use serde_json::Value;

use crate::interop::mesa;

/// A simulated 7I97 on a free port of loopback.
pub const SIM_7I97: [&str; 7] = [
    "sim",
    "--board",
    "7i97",
    "--listen",
    "127.0.0.1",
    "--port",
    "0",
];

/// Timeouts for a simulated board on a busy machine.
pub fn patient() -> UdpConfig {
    UdpConfig {
        cycle_deadline: Duration::from_secs(1),
        setup_deadline: Duration::from_secs(1),
        ..UdpConfig::default()
    }
}

/// Result of a run: exit code and output.
#[derive(Debug)]
pub struct Run {
    pub code: Option<i32>,
    pub out: String,
    pub err: String,
}

impl From<Output> for Run {
    fn from(output: Output) -> Self {
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        Self {
            code: output.status.code(),
            out: text(&output.stdout),
            err: text(&output.stderr),
        }
    }
}

/// A command line to be started: no input, no colours, no board from the environment.
pub fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(mesa());
    command
        .args(arguments)
        .env_remove("MESA_ADDR")
        .env("NO_COLOR", "1")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

/// Runs a command line to its end.
pub fn run(arguments: &[&str]) -> Run {
    command(arguments).output().expect("mesa starts").into()
}

/// Runs a command line that must succeed; returns its output.
pub fn done(arguments: &[&str]) -> String {
    let run = run(arguments);
    assert_eq!(run.code, Some(0), "{arguments:?}: {run:?}");
    run.out
}

/// Runs a command line with `--json` that must succeed, and validates its output against the
/// command's entry in `docs/mesa.schema.json`.
pub fn json(arguments: &[&str]) -> Value {
    let text = done(&[arguments, &["--json"]].concat());
    let value = serde_json::from_str(&text).expect("JSON");
    hold_against_schema(arguments.first().expect("a command"), &value);
    value
}

/// Validates a value against an entry of `docs/mesa.schema.json`.
pub fn hold_against_schema(name: &str, value: &Value) {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/mesa.schema.json");
    let mut schemas = boon::Schemas::new();
    let mut compiler = boon::Compiler::new();
    let schema = compiler.compile(&format!("{file}#/$defs/{name}"), &mut schemas);
    let schema = schema.unwrap_or_else(|error| panic!("{name}: {error:#}"));
    if let Err(error) = schemas.validate(value, schema) {
        panic!("{name} is not what the schema says: {error:#}\n{value:#}");
    }
}
