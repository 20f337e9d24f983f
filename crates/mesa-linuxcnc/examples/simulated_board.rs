//! Simulated boards, most with a 7I77 and a 7I72, for `examples/linuxcnc.sh`, in the place of `mesa
//! sim`.
//!
//!     simulated_board [ANY WORDS] --board NAME [--second NAME] --listen ADDRESS
//!
//! NAME is 7i97, 7i92-7i77, or 7i92-7i76 and 7i92-7i76-index, which have a 7I76 alone. The second
//! board is at port 27182 of the same address. Commands for the first one on standard input, one a
//! line, each answered by a line: `plug N`, `unplug N`, `field N VOLTS`, `lose PART`, `input N
//! on|off`, `watchdog N`, and `outputs`, with outputs 3 of the 7I77, 17 of the 7I72 and 2 of the
//! board.

#[path = "../tests/fake_hal/board.rs"]
mod board;

use std::io::BufRead;
use std::net::{Ipv4Addr, SocketAddrV4};

use board::Board;

fn main() {
    let option = |name: &str| std::env::args().skip_while(|word| word != name).nth(1);
    let address = option("--listen").and_then(|word| word.parse::<Ipv4Addr>().ok());
    let address = address.expect("--listen ADDRESS");
    let board = |name: &str, port| {
        let board = Board::start_named(name, SocketAddrV4::new(address, port));
        board.expect("7i97, 7i92-7i77, 7i92-7i76 or 7i92-7i76-index")
    };
    let _second = option("--second").map(|name| board(&name, 27_182));
    let board = board(&option("--board").expect("--board NAME"), 27_181);
    println!("ready");
    for line in std::io::stdin().lock().lines().map_while(Result::ok) {
        match answer(&board, &line) {
            Some(answer) => println!("{answer}"),
            None => println!("? {line}"),
        }
    }
    // Standard input may be /dev/null.
    loop {
        std::thread::park();
    }
}

fn answer(board: &Board, line: &str) -> Option<String> {
    let words: Vec<_> = line.split_whitespace().collect();
    match words[..] {
        ["outputs"] => return Some(format!("{:?}", board.outputs())),
        ["watchdog", channel] => {
            let time = board.watchdog(channel.parse().ok()?)?;
            return Some(format!("{time} ms"));
        }
        ["plug", channel] => board.plug(channel.parse().ok()?, true),
        ["unplug", channel] => board.plug(channel.parse().ok()?, false),
        ["field", channel, volts] => {
            board.set_field(channel.parse().ok()?, volts.parse().ok()?);
        }
        ["lose", part] => board.lose(part.parse().ok()?),
        ["input", number, state] => board.set_input(number.parse().ok()?, state == "on"),
        _ => return None,
    }
    Some("done".into())
}
