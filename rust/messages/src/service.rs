//! Service types: what is asked, what is answered.

use crate::definition::{DefinitionError, MessageType, hexadecimal};
use md5::{Digest, Md5};
use std::sync::Arc;

/// A service type of ROS 1.
#[derive(Clone, Debug, PartialEq)]
pub struct ServiceType {
    /// Such as `std_srvs/Empty`.
    pub name: String,
    /// What is asked.
    pub request: Arc<MessageType>,
    /// What is answered.
    pub response: Arc<MessageType>,
    md5: String,
}

impl ServiceType {
    /// Reads a service type from the text of its definition, request and response with `---` between; `source` gives
    /// the definitions of the messages that it needs.
    ///
    /// # Errors
    /// [`DefinitionError`].
    pub fn load(
        name: &str,
        text: &str,
        source: &dyn Fn(&str) -> Option<String>,
    ) -> Result<ServiceType, DefinitionError> {
        let (mut halves, mut half) = ([String::new(), String::new()], 0);
        for line in text.lines() {
            if line.trim() == "---" {
                half = 1;
            } else {
                halves[half] += line;
                halves[half].push('\n');
            }
        }
        let request = MessageType::load(&format!("{name}Request"), &halves[0], source)?;
        let response = MessageType::load(&format!("{name}Response"), &halves[1], source)?;
        // By ROS's rule nothing stands between the two.
        let both = request.checksum_text() + &response.checksum_text();
        let md5 = hexadecimal(Md5::new_with_prefix(both));
        Ok(ServiceType { name: name.to_owned(), request, response, md5 })
    }

    /// ROS's checksum over request and response, in hexadecimal.
    pub fn md5(&self) -> &str {
        &self.md5
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builtin_type;

    #[test]
    fn sums_are_those_of_ros() {
        let known = |name: &str| builtin_type(name).map(|kind| kind.full_text());
        // By rossrv md5.
        for (name, text, sum) in [
            ("std_srvs/Empty", "---\n", "d41d8cd98f00b204e9800998ecf8427e"),
            (
                "std_srvs/Trigger",
                "---\nbool success   # it went well\nstring message\n",
                "937c9679a518e3a18d831e57125ea522",
            ),
            (
                "std_srvs/SetBool",
                "bool data\n---\nbool success\nstring message\n",
                "09fb03525b03e7ea1fd3992bafd87e16",
            ),
        ] {
            assert_eq!(ServiceType::load(name, text, &known).unwrap().md5(), sum, "{name}");
        }
        let error = ServiceType::load("a/B", "Nothing x\n---\n", &known).unwrap_err().to_string();
        assert!(error.contains("a/Nothing"), "{error}");
    }
}
