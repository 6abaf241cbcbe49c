//! Messages that leave at once.
//!
//! rosrust leaves Nagle's algorithm on and has no switch for it, so that a small message waits up to 40 ms for the receipt
//! of the one before: joint states came in bursts of five, also to subscribers that had asked for `tcp_nodelay`.

use nix::sys::socket::{setsockopt, sockopt::TcpNoDelay};

/// Switches Nagle's algorithm off for every TCP socket of this process, those that listen included: what they accept
/// from then on is switched off too. Without Linux's list of open files nothing happens.
pub(super) fn set_tcp_nodelay() {
    let Ok(open) = std::fs::read_dir("/proc/self/fd") else { return };
    for file in open.flatten() {
        let Some(number) = file.file_name().to_str().and_then(|name| name.parse::<i32>().ok()) else {
            continue;
        };
        // What is no TCP socket, or was closed meanwhile, refuses.
        let _ = setsockopt(number, TcpNoDelay, &true);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::{TcpListener, TcpStream};

    #[test]
    fn sockets_that_are_open_and_those_that_are_accepted_later_do_not_wait() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let _before = TcpStream::connect(address).unwrap();
        let (accepted_before, _) = listener.accept().unwrap();
        assert!(!accepted_before.nodelay().unwrap());
        set_tcp_nodelay();
        assert!(accepted_before.nodelay().unwrap());
        let _later = TcpStream::connect(address).unwrap();
        let (accepted_later, _) = listener.accept().unwrap();
        assert!(accepted_later.nodelay().unwrap());
    }
}
