//! What visitors of the pages and of rosbridge have to show, on the command line.

use clap::Args;
use proact_http::{AccessConfig, AccessRight, AllowedAddress};
use std::{
    error::Error,
    fs::File,
    io::Read,
    net::IpAddr,
    os::unix::fs::PermissionsExt,
    path::{Path, PathBuf},
};

/// Where a token is looked for that neither option gives.
const TOKEN_VARIABLE: &str = "PROACT_TOKEN";
/// No token is as long, bytes.
const MAX_TOKEN_FILE_BYTES: u64 = 4096;

/// The token, and the names of this machine.
#[derive(Clone, Debug, Args)]
pub(crate) struct AccessArgs {
    /// What visitors must show, as ?token=TOKEN in the address. Others on this machine can read command lines: rather set
    /// PROACT_TOKEN or use --token-file
    #[arg(long, value_name = "TOKEN", conflicts_with = "token_file")]
    token: Option<String>,
    /// File that holds the token; nobody else may be allowed to read it
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
    /// Name or address under which others open this machine's pages, beside its own; may be repeated
    #[arg(long, value_name = "NAME")]
    host_name: Vec<String>,
}

impl AccessArgs {
    /// A token was asked for on the command line.
    pub(crate) fn requests_token(&self) -> bool {
        self.token.is_some() || self.token_file.is_some()
    }

    /// The token that was given, by option, file or environment.
    fn resolve_token(&self) -> Result<Option<String>, Box<dyn Error>> {
        match (&self.token, &self.token_file) {
            (Some(token), _) => Ok(Some(token.clone())),
            (None, Some(file)) => Ok(Some(read_token(file)?)),
            (None, None) => Ok(std::env::var(TOKEN_VARIABLE).ok().filter(|token| !token.is_empty())),
        }
    }

    /// Who may come to a server that only the given token guards.
    pub(crate) fn access(&self, listed: Vec<AllowedAddress>) -> Result<AccessConfig, Box<dyn Error>> {
        Ok(AccessConfig {
            allowed_addresses: listed,
            token: self.resolve_token()?,
            host_names: self.host_name.clone(),
        })
    }

    /// Who may come to a page at `bind`: where other machines can connect there always is a token, a new one if none was
    /// given. Whether it was given comes with it: then it is a secret that is not printed.
    pub(crate) fn page_access(
        &self,
        bind: IpAddr,
        listed: Vec<AllowedAddress>,
    ) -> Result<(AccessConfig, bool), Box<dyn Error>> {
        let mut access = self.access(listed)?;
        let given = access.token.is_some();
        if !given && !bind.is_loopback() {
            access.token = Some(new_token()?);
        }
        Ok((access, given))
    }
}

/// `ADDRESS`, which may watch, or `ADDRESS=act`, which may act too.
pub(crate) fn parse_allowed_address(text: &str) -> Result<AllowedAddress, String> {
    let (address, right) = match text.strip_suffix("=act") {
        Some(address) => (address, AccessRight::Control),
        None => (text, AccessRight::View),
    };
    let address = address.parse().map_err(|_| {
        format!("{text:?} is no address; expected one such as 192.168.1.20, or 192.168.1.20=act")
    })?;
    Ok(AllowedAddress { address, right })
}

fn read_token(path: &Path) -> Result<String, Box<dyn Error>> {
    let failed = |error| format!("cannot read the token in {}: {error}", path.display());
    let file = File::open(path).map_err(failed)?;
    let mode = file.metadata().map_err(failed)?.permissions().mode() & 0o777;
    if mode & 0o077 != 0 {
        return Err(format!(
            "{} holds the token and has mode {mode:04o}: others may read or change it; expected 0600: chmod 600 {}",
            path.display(),
            path.display()
        )
        .into());
    }
    let mut text = String::new();
    file.take(MAX_TOKEN_FILE_BYTES).read_to_string(&mut text).map_err(failed)?;
    match text.trim() {
        "" => Err(format!("{} is empty; expected the token, one line", path.display()).into()),
        token => Ok(token.to_owned()),
    }
}

/// A secret for a page that other machines can reach.
fn new_token() -> Result<String, Box<dyn Error>> {
    let mut secret = [0; 16];
    getrandom::fill(&mut secret).map_err(|error| format!("the system gives no random numbers: {error}"))?;
    Ok(secret.iter().map(|byte| format!("{byte:02x}")).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::{fs::Permissions, net::Ipv4Addr};

    fn args() -> AccessArgs {
        AccessArgs { token: None, token_file: None, host_name: vec![] }
    }

    #[test]
    fn a_token_file_that_others_can_read_is_refused_with_what_to_do() {
        let file = std::env::temp_dir().join(format!("proact-token-{}", std::process::id()));
        std::fs::write(&file, "a-token-from-a-file\n").unwrap();
        let args_given = AccessArgs { token_file: Some(file.clone()), ..args() };
        for (mode, fine) in [(0o644, false), (0o640, false), (0o602, false), (0o600, true), (0o400, true)] {
            std::fs::set_permissions(&file, Permissions::from_mode(mode)).unwrap();
            match args_given.resolve_token() {
                Ok(token) => assert!(fine && token.as_deref() == Some("a-token-from-a-file"), "{mode:o}"),
                Err(error) => {
                    let text = error.to_string();
                    assert!(
                        !fine && text.contains("chmod 600") && text.contains(&format!("{mode:04o}")),
                        "{text}"
                    );
                }
            }
        }
        std::fs::remove_file(&file).unwrap();
        assert!(args_given.resolve_token().unwrap_err().to_string().contains("cannot read"));
    }

    #[test]
    fn a_page_that_other_machines_reach_always_has_a_token() {
        let (here, all) = (Ipv4Addr::LOCALHOST.into(), Ipv4Addr::UNSPECIFIED.into());
        assert_eq!(args().page_access(here, vec![]).unwrap().0.token, None);
        let (access, given) = args().page_access(all, vec![]).unwrap();
        assert!(!given && access.token.unwrap().len() == 32);
        let args_given = AccessArgs { token: Some("chosen-by-the-lab".to_owned()), ..args() };
        for bind in [here, all] {
            let (access, given) = args_given.page_access(bind, vec![]).unwrap();
            assert!(given && access.token.as_deref() == Some("chosen-by-the-lab"));
        }
    }

    #[test]
    fn a_listed_address_watches_unless_it_says_act() {
        assert_eq!(parse_allowed_address("192.168.1.20").unwrap().right, AccessRight::View);
        assert_eq!(parse_allowed_address("fe80::1=act").unwrap().right, AccessRight::Control);
        for bad in ["", "headset", "192.168.1.20=drive", "=act"] {
            assert!(parse_allowed_address(bad).unwrap_err().contains("=act"), "{bad}");
        }
    }
}
