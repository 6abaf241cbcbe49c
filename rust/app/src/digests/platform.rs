use crate::libraries::library_versions;
use std::{env::consts::ARCH, fmt, process::Command};

/// The libraries whose arithmetic is in a trial.
const LIBRARIES: [&str; 5] = ["KDL", "OMPL", "ODE", "FCL", "libccd"];

/// What the last bits of a trial depend on beside our own sources: two machines of one platform give equal digests.
///
/// The mathematical functions of libc choose their code by what the processor has, so that the same libc gives two
/// kinds of results. Which of them is in force is measured, beside the features that it goes by.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Platform {
    /// Parts of the key, such as `x86_64-avx2-fma`, `glibc-2.36`, `libm-5c1d2f0a`, `ODE-0.16.2`.
    parts: Vec<String>,
}

impl Platform {
    /// That of this machine and of the libraries that this program has loaded.
    pub fn current() -> Self {
        let mut parts = vec![processor(), libc(), format!("libm-{:08x}", libm_probe())];
        let versions = library_versions();
        parts.extend(LIBRARIES.map(|name| {
            let version = versions.get(name).map_or("unknown", String::as_str);
            // Debian's epoch says nothing of the library.
            let version = version.split_once(':').map_or(version, |(_, version)| version);
            format!("{name}-{}", version.replace(|c: char| !c.is_ascii_alphanumeric() && c != '.', "-"))
        }));
        Self { parts }
    }

    /// Name of the file with its digests.
    pub fn file_name(&self) -> String {
        format!("{self}.txt")
    }
}

impl fmt::Display for Platform {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.parts.join("_"))
    }
}

/// The architecture, and of x86_64 the features that glibc's mathematical functions are chosen by.
fn processor() -> String {
    #[cfg(target_arch = "x86_64")]
    {
        let features = [
            ("avx2", std::arch::is_x86_feature_detected!("avx2")),
            ("fma", std::arch::is_x86_feature_detected!("fma")),
        ];
        let has = features.iter().filter(|(_, has)| *has).map(|(name, _)| *name);
        std::iter::once(ARCH).chain(has).collect::<Vec<_>>().join("-")
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        ARCH.to_owned()
    }
}

/// Such as `glibc-2.36`.
fn libc() -> String {
    let getconf = Command::new("getconf").arg("GNU_LIBC_VERSION").output();
    let text = getconf.ok().filter(|output| output.status.success()).map(|output| output.stdout);
    let text = String::from_utf8(text.unwrap_or_default()).unwrap_or_default();
    let words: Vec<&str> = text.split_whitespace().collect();
    if words.is_empty() { "libc-unknown".to_owned() } else { words.join("-") }
}

/// A number that differs when the mathematical functions do: their last bits over a range of arguments.
fn libm_probe() -> u32 {
    let mut sum = 0xcbf2_9ce4_u32;
    for k in 1..4000_u32 {
        let x = f64::from(std::hint::black_box(k)) * 0.00123;
        for value in [x.sin(), x.cos(), x.tan(), x.exp(), x.ln(), x.atan2(1.7), x.powf(1.3), (x / 6.0).acos()]
        {
            let bits = value.to_bits();
            // Fowler, Noll and Vo's hash: what is compared is equality alone.
            sum = (sum ^ (bits as u32) ^ (bits >> 32) as u32).wrapping_mul(0x0100_0193);
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    // Catches a key that changes from call to call, or that leaves a library out.
    #[test]
    fn the_platform_has_one_name_fit_for_a_file_with_every_library_in_it() {
        let name = Platform::current().file_name();
        assert_eq!(name, Platform::current().file_name());
        assert!(name.len() < 250 && !name.contains(['/', ':', ' ', '+', '~']), "{name}");
        for part in [ARCH, "libm-"].into_iter().chain(LIBRARIES) {
            assert!(name.contains(part), "{name} lacks {part}");
        }
    }
}
