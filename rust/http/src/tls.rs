//! HTTPS with a certificate of our own making: headset browsers give WebXR to secure pages only.

use base64::{Engine, engine::general_purpose::STANDARD};
use rcgen::{CertifiedKey, generate_simple_self_signed};
use std::{
    env, fs,
    io::{self, Read, Write},
    net::IpAddr,
    os::unix::fs::{DirBuilderExt, OpenOptionsExt, PermissionsExt},
    path::{Path, PathBuf},
    sync::Arc,
};
use tokio_rustls::{
    TlsAcceptor,
    rustls::{
        ServerConfig,
        crypto::ring,
        pki_types::{CertificateDer, PrivateKeyDer, pem::PemObject},
    },
};

/// Longest file that is taken for a certificate with its key, bytes. One has about 900.
const MAX_PEM_BYTES: u64 = 16 * 1024;

/// Where certificates are kept from start to start: `proact` in the person's folder for state, as the XDG Base Directory
/// Specification names it; none where there is no home.
pub(crate) fn certificate_folder() -> Option<PathBuf> {
    let absolute = |path: PathBuf| path.is_absolute().then_some(path);
    let state = env::var_os("XDG_STATE_HOME").map(PathBuf::from).and_then(absolute);
    let home = || env::var_os("HOME").map(PathBuf::from).and_then(absolute);
    state.or_else(|| Some(home()?.join(".local/state"))).map(|folder| folder.join("proact"))
}

/// With the certificate that `folder` keeps for this machine's names, or a new one, which is then kept there: browsers ask
/// once whether to trust it. Without a folder that can be written it is good as long as the process runs.
pub(crate) fn load_or_create_acceptor(address: IpAddr, folder: Option<&Path>) -> Result<TlsAcceptor, String> {
    let file = folder.map(|folder| folder.join(format!("https-{address}.pem")));
    if let Some(kept) =
        file.as_deref().and_then(|file| acceptor_from_pem(&read_private_file(file).ok()?).ok())
    {
        return Ok(kept);
    }
    let mut names = vec!["localhost".to_owned(), "127.0.0.1".to_owned()];
    if !address.is_loopback() && !address.is_unspecified() {
        names.push(address.to_string());
    }
    let CertifiedKey { cert, signing_key } =
        generate_simple_self_signed(names).map_err(|error| error.to_string())?;
    let pem =
        encode_pem("CERTIFICATE", cert.der()) + &encode_pem("PRIVATE KEY", &signing_key.serialize_der());
    if let Some(file) = file {
        // What cannot be kept is made anew at the next start, as before there was a place for it.
        let _ = store_private_file(&file, &pem);
    }
    acceptor_from_pem(&pem)
}

/// Bytes as text, RFC 7468.
fn encode_pem(label: &str, bytes: &[u8]) -> String {
    let text = STANDARD.encode(bytes);
    let lines: Vec<&str> = (0..text.len()).step_by(64).map(|k| &text[k..text.len().min(k + 64)]).collect();
    format!("-----BEGIN {label}-----\n{}\n-----END {label}-----\n", lines.join("\n"))
}

/// Serves with the certificate and the key in `pem`.
fn acceptor_from_pem(pem: &str) -> Result<TlsAcceptor, String> {
    let certificate = CertificateDer::from_pem_slice(pem.as_bytes()).map_err(|error| error.to_string())?;
    let key = PrivateKeyDer::from_pem_slice(pem.as_bytes()).map_err(|error| error.to_string())?;
    let mut config = ServerConfig::builder_with_provider(Arc::new(ring::default_provider()))
        .with_safe_default_protocol_versions()
        .and_then(|builder| builder.with_no_client_auth().with_single_cert(vec![certificate], key))
        .map_err(|error| error.to_string())?;
    // WebSockets need HTTP/1.1.
    config.alpn_protocols = vec![b"http/1.1".to_vec()];
    Ok(TlsAcceptor::from(Arc::new(config)))
}

/// A key that others may read is no key.
fn read_private_file(file: &Path) -> io::Result<String> {
    let opened = fs::File::open(file)?;
    if opened.metadata()?.permissions().mode() & 0o077 != 0 {
        return Err(io::ErrorKind::PermissionDenied.into());
    }
    let mut text = String::new();
    opened.take(MAX_PEM_BYTES).read_to_string(&mut text)?;
    Ok(text)
}

/// Written whole before it has its name: a start that is killed leaves no half of it.
fn store_private_file(file: &Path, pem: &str) -> io::Result<()> {
    if let Some(folder) = file.parent() {
        fs::DirBuilder::new().recursive(true).mode(0o700).create(folder)?;
    }
    let half = file.with_extension(format!("{}.new", std::process::id()));
    let mut opened =
        fs::OpenOptions::new().write(true).create(true).truncate(true).mode(0o600).open(&half)?;
    opened.write_all(pem.as_bytes())?;
    fs::rename(half, file)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::Ipv4Addr;

    const ADDRESS: IpAddr = IpAddr::V4(Ipv4Addr::new(192, 168, 7, 5));

    fn stored_certificate(folder: &Path) -> String {
        load_or_create_acceptor(ADDRESS, Some(folder)).map(|_| ()).unwrap();
        read_private_file(&folder.join("https-192.168.7.5.pem")).unwrap()
    }

    #[test]
    fn the_certificate_is_the_same_at_the_next_start() {
        let home = tempfile::tempdir().unwrap();
        let folder = home.path().join("state/proact");
        let first = stored_certificate(&folder);
        assert_eq!(stored_certificate(&folder), first);
        let mode = fs::metadata(folder.join("https-192.168.7.5.pem")).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600, "the key is the person's own");
    }

    #[test]
    fn what_is_broken_or_readable_by_others_is_made_anew() {
        let home = tempfile::tempdir().unwrap();
        let first = stored_certificate(home.path());
        let file = home.path().join("https-192.168.7.5.pem");
        store_private_file(&file, &first[..200]).unwrap();
        let second = stored_certificate(home.path());
        assert_ne!(second, first);
        fs::set_permissions(&file, fs::Permissions::from_mode(0o644)).unwrap();
        assert_ne!(stored_certificate(home.path()), second);
    }

    #[test]
    fn without_a_place_to_keep_it_there_is_a_certificate_all_the_same() {
        assert!(load_or_create_acceptor(ADDRESS, None).is_ok());
        assert!(load_or_create_acceptor(ADDRESS, Some(Path::new("/proc/no/such/place"))).is_ok());
    }
}
