use crate::ROS_SCHEMES;
use crate::vmpl::vmpl_method;
use proact_control::{Imitation, MethodEntry, MethodRegistry, Synergy};
use proact_devices::motion_capture::{CAPTURE_SCHEMES, CaptureScheme};
use proact_devices::{SINK_SCHEMES, SinkScheme, SourceRegistry};

/// What a program offers to choose from: a laboratory's own is this with a line for each thing of its own.
#[derive(Clone, Debug)]
pub struct Registry {
    /// Control methods.
    pub methods: MethodRegistry,
    /// Where EMG comes from.
    pub sources: SourceRegistry,
    /// Where tracked poses come from.
    pub captures: Vec<CaptureScheme>,
    /// Where cues go.
    pub sinks: Vec<SinkScheme>,
}

impl Registry {
    /// What ships with the program.
    pub fn standard() -> Self {
        Self {
            methods: extra_methods(MethodRegistry::standard()),
            sources: SourceRegistry::standard(),
            captures: [CAPTURE_SCHEMES.as_slice(), &ROS_SCHEMES].concat(),
            sinks: SINK_SCHEMES.to_vec(),
        }
    }
}

impl Default for Registry {
    fn default() -> Self {
        Self::standard()
    }
}

impl From<MethodRegistry> for Registry {
    fn from(methods: MethodRegistry) -> Self {
        Self { methods: extra_methods(methods), ..Self::standard() }
    }
}

/// The methods beside A to D. A program's own of such a name stays.
fn extra_methods(methods: MethodRegistry) -> MethodRegistry {
    let add = |methods: MethodRegistry, entry: MethodEntry| methods.clone().with(entry).unwrap_or(methods);
    [vmpl_method(), Synergy::entry(), Imitation::entry()].into_iter().fold(methods, add)
}
