//! The client of `--demo`: it looks, switches an output on, and ends the cycle.

use std::net::SocketAddr;

use tokio::net::TcpStream;

use super::Failure;
use super::print::print;
use super::service::{line_of, write_line};

const LAMP: &str = "hm2_7i92.0.7i77.0.0.output-03";

/// Sends its lines, and checks the answers.
pub async fn session(address: SocketAddr) -> Result<(), Failure> {
    let stream = TcpStream::connect(address).await?;
    let mut rest = Vec::new();
    for (line, expected) in [
        ("get nothing", "there is no pin nothing"),
        (&*format!("set {LAMP} 1"), "done"),
        (&*format!("set {LAMP} maybe"), "maybe is no bit"),
        ("rearm", "done"),
        ("state", "the board runs"),
        (&*format!("get {LAMP}"), "true"),
        ("get demo.uptime", "."),
        ("quit", "the cycle ends"),
    ] {
        write_line(&stream, line).await?;
        let answer = line_of(&stream, &mut rest).await?;
        print(format_args!("> {line}\n{answer}\n"));
        if !answer.contains(expected) {
            return Err(format!("{line}: {answer}, expected: {expected}").into());
        }
    }
    Ok(())
}
