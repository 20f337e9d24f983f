//! Lines of standard input and of other byte streams.

use std::io::{self, BufRead};

/// Longer lines are truncated.
const MAX_LINE: usize = 1000;

/// Passes the lines of standard input to `each` until it returns false. The end of standard input
/// ends the thread and nothing else.
pub fn read_lines(mut each: impl FnMut(&str) -> bool + Send + 'static) {
    std::thread::spawn(move || {
        let mut input = io::stdin().lock();
        while let Some(line) = read_line(&mut input) {
            if !each(&line) {
                return;
            }
        }
    });
}

/// Reads a line of arbitrary bytes, without its end; `None` at the end of the input.
pub fn read_line(input: &mut impl BufRead) -> Option<String> {
    let mut line = Vec::new();
    loop {
        let bytes = match input.fill_buf() {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Err(_) => return None,
        };
        if bytes.is_empty() && line.is_empty() {
            return None;
        }
        let end = bytes.iter().position(|&byte| byte == b'\n');
        let part = end.unwrap_or(bytes.len());
        let room = MAX_LINE.saturating_sub(line.len()).min(part);
        line.extend_from_slice(&bytes[..room]);
        let at_end = end.is_some() || bytes.is_empty();
        let used = part + usize::from(end.is_some());
        input.consume(used);
        if at_end {
            return Some(String::from_utf8_lossy(&line).into_owned());
        }
    }
}
