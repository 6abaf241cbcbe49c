//! A user's own condition on arm angles, asked by the search in C++.

use std::panic::{AssertUnwindSafe, catch_unwind};

/// A closure that C++ calls. A panic must not cross the boundary: it counts as "no", and so does every later question.
pub(crate) struct StateCheck<'a> {
    accepts: &'a mut dyn FnMut(&[f64]) -> bool,
    panicked: Option<String>,
}

impl<'a> StateCheck<'a> {
    pub fn new(accepts: &'a mut dyn FnMut(&[f64]) -> bool) -> Self {
        Self { accepts, panicked: None }
    }

    pub fn accepts(&mut self, q: &[f64]) -> bool {
        if self.panicked.is_some() {
            return false;
        }
        match catch_unwind(AssertUnwindSafe(|| (self.accepts)(q))) {
            Ok(answer) => answer,
            Err(payload) => {
                let text = payload.downcast_ref::<&str>().map(|t| (*t).to_owned());
                let text = text.or_else(|| payload.downcast_ref::<String>().cloned());
                self.panicked = Some(text.unwrap_or_else(|| "no message".to_owned()));
                false
            }
        }
    }

    /// What the closure panicked with.
    pub fn panicked(self) -> Option<String> {
        self.panicked
    }
}
