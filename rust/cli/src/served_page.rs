//! Where a page for people who drive is served, and how they are told.

use crate::{
    access_args::{AccessArgs, parse_allowed_address},
    announce::{announce, redact_token},
};
use clap::Args;
use proact_app::print_status;
use proact_arm::Side;
use proact_bridge::{PageContent, PageOptions, PageServer};
use proact_http::AllowedAddress;
use std::{
    error::Error,
    net::{IpAddr, Ipv4Addr},
};

/// Where and for whom the page is served.
#[derive(Clone, Debug, Args)]
pub(crate) struct ServedPageArgs {
    /// Port of the page
    #[arg(long, default_value_t = 8090)]
    port: u16,
    /// Fail if the port is taken instead of trying the next ones
    #[arg(long)]
    exact_port: bool,
    /// Address to listen on; where other machines can connect, everybody needs the token that is printed then
    #[arg(long, default_value = "127.0.0.1")]
    bind: IpAddr,
    /// Machine that needs no token to watch the page, with =act to drive and end trials too; may be repeated
    #[arg(long, value_name = "ADDRESS[=act]", value_parser = parse_allowed_address)]
    page_allow: Vec<AllowedAddress>,
    /// For a headset: HTTPS on all addresses, and a QR code to open the page with
    #[arg(long)]
    headset: bool,
    /// Print the address of the page, open nothing
    #[arg(long)]
    no_browser: bool,
}

impl ServedPageArgs {
    /// Begins to serve, and tells where.
    ///
    /// # Errors
    /// A port or an address that cannot be had, a token that cannot be read.
    pub(crate) fn start(
        &self,
        access: &AccessArgs,
        brace_controller: Option<Side>,
        content: PageContent,
    ) -> Result<PageServer, Box<dyn Error>> {
        let bind = if self.headset { Ipv4Addr::UNSPECIFIED.into() } else { self.bind };
        let (access, secret) = access.page_access(bind, self.page_allow.clone())?;
        let allow_next = !self.exact_port;
        let options = PageOptions {
            port: self.port,
            allow_next_port: allow_next,
            bind,
            https: self.headset,
            access,
            brace_controller,
            ..Default::default()
        };
        let server = PageServer::start(options, content)?;
        announce(&server, "", !self.no_browser, secret);
        announce_remote(&server, self.headset, secret)?;
        Ok(server)
    }
}

/// Tells how to open the page on another machine, for a headset as a QR code.
fn announce_remote(server: &PageServer, headset: bool, secret: bool) -> Result<(), Box<dyn Error>> {
    let Some(url) = server.remote_url() else { return Ok(()) };
    print_status(format_args!("on another machine: {}", redact_token(&url, secret)));
    if headset {
        print_status(qr_code(&url)?);
        print_status(
            "The certificate is our own: the browser asks once whether to go on, and not again at the next start.",
        );
    }
    Ok(())
}

/// The QR code of `text` in black on white, whatever the colours of the terminal are: scanners want dark on light.
fn qr_code(text: &str) -> Result<String, qrcode::types::QrError> {
    const BLACK_ON_WHITE: &str = "\x1b[38;5;16;48;5;231m";
    let code = qrcode::QrCode::new(text)?;
    let picture = code.render::<qrcode::render::unicode::Dense1x2>().build();
    Ok(picture.lines().map(|line| format!("{BLACK_ON_WHITE}{line}\x1b[0m\n")).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The modules of what is printed, dark ones true, as a scanner sees them on a terminal of any colours.
    fn seen(printed: &str) -> Result<Vec<Vec<bool>>, String> {
        let mut rows = Vec::new();
        for line in printed.lines() {
            let line = line.strip_prefix("\x1b[38;5;16;48;5;231m").ok_or("no colours of its own")?;
            let line = line.strip_suffix("\x1b[0m").ok_or("the colours go on")?;
            let halves: &[fn(char) -> bool] =
                &[|c| matches!(c, '\u{2580}' | '\u{2588}'), |c| matches!(c, '\u{2584}' | '\u{2588}')];
            rows.extend(halves.iter().map(|dark| line.chars().map(dark).collect::<Vec<_>>()));
        }
        Ok(rows)
    }

    #[test]
    fn the_qr_code_is_dark_on_light_with_a_margin_on_any_terminal() -> Result<(), Box<dyn Error>> {
        let url = "https://192.168.1.20:8090/?token=0123456789abcdef";
        let rows = seen(&qr_code(url)?)?;
        let code = qrcode::QrCode::new(url)?;
        const MARGIN: usize = 4;
        assert!(rows[..MARGIN].iter().flatten().all(|dark| !dark), "light around it");
        let width = code.width();
        for (y, modules) in code.to_colors().chunks(width).enumerate() {
            for (x, module) in modules.iter().enumerate() {
                let dark = *module == qrcode::Color::Dark;
                assert_eq!(rows[y + MARGIN][x + MARGIN], dark, "module {x}, {y}");
            }
        }
        Ok(())
    }
}
