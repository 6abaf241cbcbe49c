//! The services whose types are known without a ROS installation, and a call's arguments by name, checked.

use proact_messages::{MessageType, ServiceType, Time, ros1_name};
use serde_json::{Map, Value as Json};
use std::{
    collections::BTreeMap,
    sync::{Arc, LazyLock},
};

/// Services with their requests and responses, as in `.srv` files.
const SERVICES: [(&str, &str, &str); 29] = [
    ("rosapi/DeleteParam", "string name", ""),
    ("rosapi/GetActionServers", "", "string[] action_servers"),
    ("rosapi/GetParam", "string name\nstring default", "string value"),
    ("rosapi/GetParamNames", "", "string[] names"),
    ("rosapi/GetROSVersion", "", "uint8 version\nstring distro"),
    ("rosapi/GetTime", "", "time time"),
    ("rosapi/HasParam", "string name", "bool exists"),
    ("rosapi/MessageDetails", "string type", "TypeDef[] typedefs"),
    ("rosapi/NodeDetails", "string node", "string[] subscribing\nstring[] publishing\nstring[] services"),
    ("rosapi/Nodes", "", "string[] nodes"),
    ("rosapi/Publishers", "string topic", "string[] publishers"),
    ("rosapi/ServiceHost", "string service", "string host"),
    ("rosapi/ServiceNode", "string service", "string node"),
    ("rosapi/ServiceProviders", "string service", "string[] providers"),
    ("rosapi/ServiceRequestDetails", "string type", "TypeDef[] typedefs"),
    ("rosapi/ServiceResponseDetails", "string type", "TypeDef[] typedefs"),
    ("rosapi/ServiceType", "string service", "string type"),
    ("rosapi/Services", "", "string[] services"),
    ("rosapi/ServicesForType", "string type", "string[] services"),
    ("rosapi/SetParam", "string name\nstring value", ""),
    ("rosapi/Subscribers", "string topic", "string[] subscribers"),
    ("rosapi/TopicType", "string topic", "string type"),
    ("rosapi/Topics", "", "string[] topics\nstring[] types"),
    ("rosapi/TopicsAndRawTypes", "", "string[] topics\nstring[] types\nstring[] typedefs_full_text"),
    ("rosapi/TopicsForType", "string type", "string[] topics"),
    (
        "shoulder_localization/fixWorld",
        "bool fixWorld",
        "float64 x\nfloat64 y\nfloat64 z\nfloat64 qx\nfloat64 qy\nfloat64 qz\nfloat64 qw",
    ),
    ("std_srvs/Empty", "", ""),
    ("std_srvs/SetBool", "bool data", "bool success\nstring message"),
    ("std_srvs/Trigger", "", "bool success\nstring message"),
];

/// rosapi's description of a message type.
const TYPE_DEFINITION: &str = "string type\nstring[] fieldnames\nstring[] fieldtypes\nint32[] fieldarraylen\n\
    string[] examples\nstring[] constnames\nstring[] constvalues";

static BUILTIN_SERVICE_TYPES: LazyLock<BTreeMap<&str, Arc<ServiceType>>> = LazyLock::new(|| {
    let source = |name: &str| (name == "rosapi/TypeDef").then(|| TYPE_DEFINITION.to_owned());
    let service = |(name, request, response): (&'static str, &str, &str)| {
        let kind = ServiceType::load(name, &format!("{request}\n---\n{response}\n"), &source);
        (name, Arc::new(kind.expect("the table has fields of plain kinds and one type only")))
    };
    SERVICES.into_iter().map(service).collect()
});

/// A service type, if it is known.
pub(crate) fn builtin_service_type(type_name: &str) -> Option<Arc<ServiceType>> {
    BUILTIN_SERVICE_TYPES.get(&*ros1_name(type_name)).cloned()
}

/// The arguments of a call by name. Those of a known type are checked, and may be a list in the order of its fields; what
/// is left out gets zero, empty or false.
///
/// # Errors
/// One sentence.
pub(crate) fn arguments_by_name(request: Option<&MessageType>, arguments: Json) -> Result<Json, String> {
    let arguments = match arguments {
        Json::Null => Json::Object(Map::new()),
        Json::Array(_) | Json::Object(_) => arguments,
        other => return Err(format!("the arguments are {other}, expected an object or a list")),
    };
    let Some(request) = request else { return Ok(arguments) };
    let by_name = match arguments {
        Json::Array(values) if values.len() > request.fields.len() => {
            let names: Vec<&str> = request.fields.iter().map(|field| &*field.name).collect();
            return Err(format!(
                "got {} arguments, expected at most {}: {names:?}",
                values.len(),
                names.len()
            ));
        }
        Json::Array(values) => {
            let names = request.fields.iter().map(|field| field.name.to_string());
            Json::Object(names.zip(values).collect())
        }
        named => named,
    };
    let value = request.parse_json(by_name, Time::default()).map_err(|error| error.to_string())?;
    serde_json::to_value(value).map_err(|error| error.to_string())
}
