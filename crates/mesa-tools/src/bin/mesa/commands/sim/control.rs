//! Control sockets: the console for other programs.

use std::fmt;
use std::fs;
use std::io::{self, BufReader, Read, Write};
use std::net::{Ipv4Addr, Shutdown, TcpListener, TcpStream};
use std::os::unix::fs::FileTypeExt;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::Duration;

use super::network::Network;
use crate::ui::input::read_line;

/// Maximum number of concurrent clients, over all sockets.
const MAX_CLIENTS: usize = 16;

/// Write timeout: a client that does not take its answer within this time is dropped.
const PATIENCE: Duration = Duration::from_secs(10);

/// Address of a control socket: a TCP port of loopback, or the path of a Unix socket.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Control {
    Port(u16),
    Path(PathBuf),
}

/// The form used on the command line.
impl fmt::Display for Control {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Port(port) => write!(f, "{port}"),
            Self::Path(path) => write!(f, "{}", path.display()),
        }
    }
}

impl FromStr for Control {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text.is_empty() {
            return Err("expected a TCP port or the path of a Unix socket".to_owned());
        }
        if text.bytes().all(|byte| byte.is_ascii_digit()) {
            let port = text.parse().map(Self::Port);
            return port.map_err(|_| format!("`{text}` is no port: expected 0 to 65535"));
        }
        Ok(Self::Path(PathBuf::from(text)))
    }
}

enum Listener {
    Tcp(TcpListener),
    Unix(UnixListener),
}

/// A listening control socket. A Unix socket is removed at the end.
pub struct Socket {
    listener: Option<Listener>,
    path: Option<PathBuf>,
    /// Readable address.
    pub place: String,
}

impl Socket {
    /// Binds and listens, without accepting clients yet.
    pub fn bind(control: &Control) -> io::Result<Self> {
        match control {
            Control::Port(port) => {
                let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, *port))?;
                Ok(Self {
                    place: listener.local_addr()?.to_string(),
                    listener: Some(Listener::Tcp(listener)),
                    path: None,
                })
            }
            Control::Path(path) => {
                remove_stale(path)?;
                Ok(Self {
                    listener: Some(Listener::Unix(UnixListener::bind(path)?)),
                    place: path.display().to_string(),
                    path: Some(path.clone()),
                })
            }
        }
    }

    /// Serves clients, each in a thread of its own.
    pub fn serve(&mut self, network: &Network, clients: &Arc<AtomicUsize>) {
        let (network, clients) = (network.clone(), Arc::clone(clients));
        let Some(listener) = self.listener.take() else {
            return;
        };
        thread::spawn(move || {
            loop {
                let taken = match &listener {
                    Listener::Tcp(listener) => {
                        let stream = listener.accept().map(|(stream, _)| stream);
                        stream.and_then(|stream| serve_tcp(stream, &network, &clients))
                    }
                    Listener::Unix(listener) => {
                        let stream = listener.accept().map(|(stream, _)| stream);
                        stream.and_then(|stream| serve_unix(stream, &network, &clients))
                    }
                };
                if taken.is_err() {
                    // For example too many open files, until other clients close some.
                    thread::sleep(Duration::from_millis(10));
                }
            }
        });
    }
}

impl Drop for Socket {
    fn drop(&mut self) {
        if let Some(path) = &self.path {
            let _ = fs::remove_file(path);
        }
    }
}

/// Removes the socket of a process that was killed; leaves anything else alone.
fn remove_stale(path: &Path) -> io::Result<()> {
    let Ok(found) = fs::symlink_metadata(path) else {
        return Ok(());
    };
    let gone = |error: &io::Error| error.kind() == io::ErrorKind::ConnectionRefused;
    let is_stale =
        found.file_type().is_socket() && UnixStream::connect(path).is_err_and(|error| gone(&error));
    if is_stale {
        return fs::remove_file(path);
    }
    let reason = "there is something already, in use; name another path";
    Err(io::Error::new(io::ErrorKind::AddrInUse, reason))
}

fn serve_tcp(stream: TcpStream, network: &Network, clients: &Arc<AtomicUsize>) -> io::Result<()> {
    stream.set_nodelay(true)?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let reader = stream.try_clone()?;
    let end = |stream: &TcpStream| {
        let _ = stream.shutdown(Shutdown::Both);
    };
    begin(reader, stream, end, network, clients);
    Ok(())
}

fn serve_unix(stream: UnixStream, network: &Network, clients: &Arc<AtomicUsize>) -> io::Result<()> {
    stream.set_write_timeout(Some(PATIENCE))?;
    let reader = stream.try_clone()?;
    let end = |stream: &UnixStream| {
        let _ = stream.shutdown(Shutdown::Both);
    };
    begin(reader, stream, end, network, clients);
    Ok(())
}

/// Serves a client in a thread of its own, if the limit of clients permits.
fn begin<S: Write + Send + 'static>(
    reader: impl Read + Send + 'static,
    mut writer: S,
    end: impl Fn(&S) + Send + 'static,
    network: &Network,
    clients: &Arc<AtomicUsize>,
) {
    if clients.fetch_add(1, Ordering::Relaxed) >= MAX_CLIENTS {
        clients.fetch_sub(1, Ordering::Relaxed);
        let _ = writeln!(
            writer,
            "error: no more than {MAX_CLIENTS} clients at a time"
        );
        end(&writer);
        return;
    }
    let (network, clients) = (network.clone(), Arc::clone(clients));
    thread::spawn(move || {
        talk(reader, &mut writer, &network);
        end(&writer);
        clients.fetch_sub(1, Ordering::Relaxed);
    });
}

fn talk(reader: impl Read, writer: &mut impl Write, network: &Network) {
    let mut reader = BufReader::new(reader);
    while let Some(line) = read_line(&mut reader) {
        let answer = network.answer(&line);
        let sent = writer
            .write_all(answer.text.as_bytes())
            .and_then(|()| writer.flush());
        if answer.quit {
            network.shared.end();
        }
        if sent.is_err() || answer.quit {
            return;
        }
    }
}
