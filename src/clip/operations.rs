//! The list of all edits with their arguments, from the types of [`super::op`].

use schemars::{SchemaGenerator, generate::SchemaSettings};
use serde::Serialize;
use serde_json::Value;

use super::op::Op;

/// An edit, as in JSON.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Operation {
    /// The value of `op`.
    pub name: String,
    /// What it does.
    pub about: String,
    /// The members of `args`.
    pub args: Vec<Argument>,
}

/// An argument of an edit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Argument {
    /// Its name.
    pub name: String,
    /// Its type in words, for instance `list: whole number`.
    pub kind: String,
    /// What it is.
    pub about: String,
    /// Whether it must be given.
    pub required: bool,
}

/// All edits that scripts make, by name. `patch` is left out: `robert clip diff` writes it.
pub fn operations() -> Vec<Operation> {
    let settings = SchemaSettings::draft2020_12().for_deserialize();
    let root = SchemaGenerator::new(settings).root_schema_for::<Op>().to_value();
    let parts = Parts { parts: &root["$defs"] };
    let all = root["oneOf"].as_array().into_iter().flatten();
    let mut found: Vec<_> = all.map(|one| parts.operation(one)).collect();
    found.retain(|one| one.name != "patch");
    found.sort_by(|a, b| a.name.cmp(&b.name));
    found
}

/// The named parts of a schema.
struct Parts<'a> {
    parts: &'a Value,
}

impl<'a> Parts<'a> {
    fn operation(&self, one: &Value) -> Operation {
        let args = self.named(&one["properties"]["args"]);
        Operation {
            name: text(&one["properties"]["op"]["const"]),
            about: text(&one["description"]),
            args: self.arguments(args),
        }
    }

    fn arguments(&self, args: &Value) -> Vec<Argument> {
        let Some(members) = args["properties"].as_object() else { return Vec::new() };
        let required = |name: &str| {
            args["required"].as_array().is_some_and(|all| all.iter().any(|one| one == name))
        };
        let mut found: Vec<_> = members
            .iter()
            .map(|(name, member)| Argument {
                name: name.clone(),
                kind: self.kind(member),
                about: text(&member["description"]),
                required: required(name),
            })
            .collect();
        found.sort_by_key(|argument| !argument.required);
        found
    }

    /// The part to which a schema refers, or itself.
    fn named<'b>(&self, schema: &'b Value) -> &'b Value
    where
        'a: 'b,
    {
        name_of(schema).map_or(schema, |name| &self.parts[name])
    }

    /// The type of a value in words.
    fn kind(&self, schema: &Value) -> String {
        if let Some(name) = name_of(schema) {
            let part = &self.parts[name];
            return match &words_of(part)[..] {
                [] if name == "#" => "operation".to_owned(),
                [] => format!("{} as in a clip", name.to_lowercase()),
                words => words.join(", "),
            };
        }
        if let Some(choices) = schema["anyOf"].as_array() {
            let is_null = |one: &&Value| one["type"] == "null";
            let kinds: Vec<_> =
                choices.iter().filter(|one| !is_null(one)).map(|one| self.kind(one)).collect();
            return or_null(kinds.join(" or "), schema);
        }
        let types = match &schema["type"] {
            Value::Array(types) => types.iter().map(text).collect(),
            one => vec![text(one)],
        };
        let first = types.iter().find(|t| *t != "null").map_or("any", String::as_str);
        let kind = match first {
            "array" => format!("list: {}", self.kind(&schema["items"])),
            "object" if schema["additionalProperties"].is_object() => {
                format!("{} by name", self.kind(&schema["additionalProperties"]))
            }
            "integer" => "whole number".to_owned(),
            "string" => "text".to_owned(),
            "boolean" => "true or false".to_owned(),
            other => other.to_owned(),
        };
        // In a list `null` stands for a joint without a value; elsewhere a member is absent.
        if schema["description"].is_null() && types.iter().any(|t| t == "null") {
            return format!("{kind} or null");
        }
        or_null(kind, schema)
    }
}

/// The words among which a value is chosen; none if it is of another kind.
fn words_of(part: &Value) -> Vec<String> {
    if let Some(words) = part["enum"].as_array() {
        return words.iter().map(text).collect();
    }
    let choices = part["oneOf"].as_array().or(part["anyOf"].as_array());
    choices
        .into_iter()
        .flatten()
        .filter_map(|one| Some(one["const"].as_str()?.to_owned()))
        .collect()
}

fn or_null(kind: String, schema: &Value) -> String {
    if schema["x-null"] == true { format!("{kind} or null") } else { kind }
}

fn name_of(schema: &Value) -> Option<&str> {
    schema["$ref"].as_str()?.rsplit('/').next()
}

/// A text in one line.
fn text(value: &Value) -> String {
    value.as_str().unwrap_or_default().split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[test]
    fn every_edit_says_what_it_takes() {
        let all = operations();
        let by_name: BTreeMap<_, _> = all.iter().map(|one| (one.name.as_str(), one)).collect();
        assert!(by_name.len() == all.len() && all.len() > 30 && !by_name.contains_key("patch"));
        for one in &all {
            assert!(one.about.ends_with('.') && !one.args.is_empty(), "{one:?}");
            assert!(
                one.args.iter().all(|a| a.about.ends_with('.') && !a.kind.is_empty()),
                "{one:?}"
            );
        }
        let args = |name: &str| -> Vec<_> {
            let args = by_name[name].args.iter();
            args.map(|a| (a.name.as_str(), a.kind.as_str(), a.required)).collect()
        };
        let whole = "whole number";
        assert_eq!(
            args("keys.scale"),
            [
                ("factor", "number", true),
                ("frames", "list: whole number", true),
                ("pivot", whole, true),
                ("replace", "true or false", false)
            ]
        );
        assert!(args("keys.set").contains(&("q", "list: number or null", false)));
        let fill = "mask, linear, cubic, hold or null";
        assert!(args("fill.set").contains(&("fill", fill, false)));
        assert_eq!(args("batch")[0], ("ops", "list: operation", true));
        assert!(args("blocks.insert").contains(&("blend", whole, false)));
    }
}
