use serde_json::Value as Json;
use toml::Value as Toml;

/// A tree of values with names: of TOML, or of JSON.
pub trait ConfigTree: Sized {
    /// The value called `key`, if this is a table that has it.
    fn child_mut(&mut self, key: &str) -> Option<&mut Self>;

    /// The values of a list; none if this is no list.
    fn items_mut(&mut self) -> &mut [Self];

    /// Takes the value called `key` out, if this is a table that has it.
    fn take(&mut self, key: &str) -> Option<Self>;

    /// Puts a value into a table.
    fn put(&mut self, key: &str, value: Self);

    /// A table with one value.
    fn table(key: &str, value: Self) -> Self;

    /// The name and the value of a table that has one; otherwise the tree as it was.
    ///
    /// # Errors
    /// The tree itself if it is no such table.
    fn into_entry(self) -> Result<(String, Self), Self>;

    /// Multiplies a number, or all numbers of a list. A whole number stays one: where one is expected, TOML takes no other.
    fn scale(&mut self, factor: f64);
}

impl ConfigTree for Toml {
    fn child_mut(&mut self, key: &str) -> Option<&mut Self> {
        self.as_table_mut()?.get_mut(key)
    }

    fn items_mut(&mut self) -> &mut [Self] {
        self.as_array_mut().map_or(&mut [], |items| items.as_mut_slice())
    }

    fn take(&mut self, key: &str) -> Option<Self> {
        self.as_table_mut()?.remove(key)
    }

    fn put(&mut self, key: &str, value: Self) {
        if let Some(table) = self.as_table_mut() {
            table.insert(key.to_owned(), value);
        }
    }

    fn table(key: &str, value: Self) -> Self {
        Toml::Table(toml::Table::from_iter([(key.to_owned(), value)]))
    }

    fn into_entry(self) -> Result<(String, Self), Self> {
        match self {
            Toml::Table(table) if table.len() == 1 => {
                let one = table.into_iter().next();
                one.ok_or_else(|| Toml::Table(toml::Table::new()))
            }
            other => Err(other),
        }
    }

    fn scale(&mut self, factor: f64) {
        let number = match self {
            #[expect(clippy::cast_precision_loss, reason = "settings are no larger than 2^53")]
            Toml::Integer(number) => *number as f64,
            Toml::Float(number) => *number,
            Toml::Array(items) => return items.iter_mut().for_each(|item| item.scale(factor)),
            _ => return,
        };
        let number = number * factor;
        *self = whole_number(number).map_or(Toml::Float(number), Toml::Integer);
    }
}

impl ConfigTree for Json {
    fn child_mut(&mut self, key: &str) -> Option<&mut Self> {
        self.as_object_mut()?.get_mut(key)
    }

    fn items_mut(&mut self) -> &mut [Self] {
        self.as_array_mut().map_or(&mut [], |items| items.as_mut_slice())
    }

    fn take(&mut self, key: &str) -> Option<Self> {
        self.as_object_mut()?.remove(key)
    }

    fn put(&mut self, key: &str, value: Self) {
        if let Some(table) = self.as_object_mut() {
            table.insert(key.to_owned(), value);
        }
    }

    fn table(key: &str, value: Self) -> Self {
        Json::Object(serde_json::Map::from_iter([(key.to_owned(), value)]))
    }

    fn into_entry(self) -> Result<(String, Self), Self> {
        match self {
            Json::Object(table) if table.len() == 1 => {
                let one = table.into_iter().next();
                one.ok_or_else(|| Json::Object(serde_json::Map::new()))
            }
            other => Err(other),
        }
    }

    fn scale(&mut self, factor: f64) {
        match self {
            Json::Number(number) => {
                let Some(value) = number.as_f64().map(|value| value * factor) else { return };
                *self = whole_number(value).map_or_else(|| Json::from(value), Json::from);
            }
            Json::Array(items) => items.iter_mut().for_each(|item| item.scale(factor)),
            _ => {}
        }
    }
}

/// `number` as a whole one if it is, and so small that every whole number up to it is a float.
fn whole_number(number: f64) -> Option<i64> {
    #[expect(clippy::cast_possible_truncation, reason = "it is checked")]
    (number.fract() == 0.0 && number.abs() < 9.0e15).then_some(number as i64)
}
