//! The page's half of the protocol: TypeScript generated from the types that the server uses.
//!
//! `schemars` describes each type twice, as serde writes it and as serde reads it, so a field with
//! a default is optional in what the page sends and always present in what it receives. The few
//! kinds of schema that our types need are turned into TypeScript here. All of this is compiled for
//! tests only.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::Path;

use schemars::generate::SchemaSettings;
use schemars::{JsonSchema, SchemaGenerator};
use serde_json::{Map, Value};

use super::{
    ClipQuery, DocumentView, Draft, DrawAnswer, DrawRequest, Edited, Event, ExampleQuery,
    ExportFormat, ExportQuery, ExportRequest, FilesQuery, GalleryItem, Geometry, HoverQuery,
    Hovered, IkAnswer, IkRequest, ImportBody, InsertQuery, JobRequest, JobView, LinesFrom, Listing,
    MeanError, NewBody, OpsRequest, PathBody, Pose, PoseQuery, Poses, RecentFile, RobotCard,
    RobotFacts, RolloutView, SaveBody, Saved, SettleAnswer, Shelf, State, StillBodyQuery,
    StillQuery, StudioOp, TakeFrames, TakesView, ThumbnailQuery, UploadQuery,
};
use robert_clip::{ClipShape, Op};

/// The generated file, relative to the project's folder.
const FILE: &str = "ui/src/generated/protocol.ts";

const HEAD: &str = "\
// Generated from the server's types by `ROBERT_BLESS=1 cargo test -p robert-studio protocol`; do not edit.
// Values are rad, m, s and frames of 1/20 s.

/** Any JSON. */
export type Json = null | boolean | number | string | Json[] | { [name: string]: Json };
";

const TAIL: &str = "
/** What the page sends on the socket, beside an `id`. */
export type Request = Op | StudioOp;

/** The arguments of the operation of this name. */
export type Args<Name extends Request[\"op\"]> = Extract<Request, { op: Name }>[\"args\"];
";

/// Types that the page sends back complete, as it received them, although some fields are optional.
const SENT_WHOLE: [&str; 1] = ["RolloutSettings"];

#[test]
fn typescript_is_up_to_date() {
    let text = generated();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(FILE);
    if std::env::var_os("ROBERT_BLESS").is_some() {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, &text).unwrap();
    }
    let there = std::fs::read_to_string(&path).unwrap_or_default();
    let line = there.lines().zip(text.lines()).position(|(a, b)| a != b);
    assert!(
        there == text,
        "{FILE}:{}: does not say what the server's types say; \
         ROBERT_BLESS=1 cargo test -p robert-studio protocol writes it anew",
        line.map_or(there.lines().count().min(text.lines().count()), |l| l) + 1
    );
}

/// Every route of the router is described here, and no other route.
#[test]
fn routes_are_those_of_the_router() {
    let mut page = Page::new();
    page.describe();
    let ours: BTreeSet<String> = page.routes.iter().map(|r| r.address.clone()).collect();
    let mut theirs = BTreeSet::new();
    let router = include_str!("../http/router.rs");
    for (at, _) in router.match_indices(".route(\"/api/") {
        let line = router[at..].lines().next().unwrap();
        let path = line.split('"').nth(1).unwrap().replace("{*", "{");
        for method in ["get", "post", "put"] {
            if line.contains(&format!("{method}(")) && path != "/api/ws" {
                theirs.insert(format!("{} {path}", method.to_uppercase()));
            }
        }
    }
    assert_eq!(ours, theirs);
}

fn generated() -> String {
    let mut page = Page::new();
    page.describe();
    page.finish()
}

/// A request over HTTP and what comes back; TypeScript types.
struct Route {
    address: String,
    query: Option<String>,
    body: Option<String>,
    answer: String,
}

/// The types to generate.
struct Page {
    /// Types that the page receives, as serde writes them.
    got: SchemaGenerator,
    /// Types that the page sends, as serde reads them.
    sent: SchemaGenerator,
    routes: Vec<Route>,
}

impl Page {
    fn new() -> Page {
        let settings = SchemaSettings::draft2020_12();
        Page {
            got: settings.clone().for_serialize().into_generator(),
            sent: settings.for_deserialize().into_generator(),
            routes: Vec::new(),
        }
    }

    /// Socket and HTTP.
    fn describe(&mut self) {
        self.got.subschema_for::<Event>();
        // A clip that is received leaves out the same fields as a clip that is sent may.
        self.sent.subschema_for::<ClipShape>();
        self.sent.subschema_for::<Op>();
        self.sent.subschema_for::<StudioOp>();

        self.route("POST /api/session");
        self.route("GET /api/state").gives::<State>();
        self.route("GET /api/clip").gives::<ClipShape>();
        self.route("PUT /api/clip").takes_file().gives::<Edited>();
        self.route("POST /api/ops").takes::<OpsRequest>().gives::<Edited>();
        self.route("POST /api/undo").gives::<Edited>();
        self.route("POST /api/redo").gives::<Edited>();
        self.route("POST /api/discard").gives::<Edited>();
        self.route("POST /api/reload").gives::<Edited>();
        self.route("POST /api/open").takes::<PathBody>().gives::<DocumentView>();
        self.route("POST /api/new").takes::<NewBody>().gives::<DocumentView>();
        self.route("POST /api/save").takes::<SaveBody>().gives::<Saved>();
        self.route("POST /api/close");
        self.route("GET /api/thumbnail.jpg").asks::<ThumbnailQuery>();
        self.route("GET /api/formats").gives::<Vec<ExportFormat>>();
        self.route("GET /api/files").asks::<FilesQuery>().gives::<Listing>();
        self.route("POST /api/clips").asks::<ClipQuery>().takes_file().gives::<DocumentView>();
        self.route("POST /api/insert").asks::<InsertQuery>().takes_file().gives::<Edited>();
        self.route("GET /api/gallery").gives::<Vec<GalleryItem>>();
        self.route("POST /api/gallery/{id}").gives::<DocumentView>();
        self.route("GET /api/recent").gives::<Vec<RecentFile>>();
        self.route("GET /api/drafts").gives::<Vec<Draft>>();
        self.route("POST /api/drafts/{number}").gives::<DocumentView>();
        self.route("POST /api/drafts/{number}/discard");
        self.route("GET /api/robots").gives::<Vec<RobotCard>>();
        self.route("GET /api/robot/{id}").gives::<RobotFacts>();
        self.route("GET /api/robot/{id}/geometry").gives::<Geometry>();
        self.route("POST /api/kinematics").takes::<Poses>().gives::<Vec<Vec<f32>>>();
        self.route("POST /api/ik").takes::<IkRequest>().gives::<IkAnswer>();
        self.route("POST /api/draw").takes::<DrawRequest>().gives::<DrawAnswer>();
        self.route("POST /api/settle").takes::<Pose>().gives::<SettleAnswer>();
        self.route("GET /api/rollout").gives::<RolloutView>();
        self.route("GET /api/takes").gives::<TakesView>();
        self.route("GET /api/takes/{id}").gives::<TakeFrames>();
        self.route("GET /api/export").asks::<ExportQuery>().gives_file();
        self.route("POST /api/exports").takes::<ExportRequest>().gives::<JobView>();
        self.route("GET /api/shelf").gives::<Shelf>();
        self.route("GET /api/curves").asks::<PathBody>().gives::<Vec<Map<String, Value>>>();
        self.route("PUT /api/upload").asks::<UploadQuery>().takes_file();
        self.route("POST /api/import").takes::<ImportBody>().gives::<JobView>();
        self.route("GET /api/jobs").gives::<Vec<JobView>>();
        self.route("POST /api/jobs").takes::<JobRequest>().gives::<JobView>();
        self.route("GET /api/jobs/{id}").asks::<LinesFrom>().gives::<JobView>();
        self.route("GET /api/jobs/{id}/file").gives_file();
        self.route("POST /api/jobs/{id}/cancel").gives::<JobView>();
        self.route("POST /api/jobs/{id}/resume").gives::<JobView>();
        self.route("GET /api/still.jpg").asks::<StillQuery>().gives_file();
        self.route("GET /api/hover").asks::<HoverQuery>().gives::<Option<Hovered>>();
        self.route("GET /api/still-body").asks::<StillBodyQuery>().gives::<Option<String>>();
        self.route("GET /api/pose.jpg").asks::<PoseQuery>().gives_file();
        self.route("GET /api/gallery-picture.jpg").asks::<ExampleQuery>().gives_file();
        self.route("GET /api/gallery-error").asks::<ExampleQuery>().gives::<Option<MeanError>>();
    }

    /// A route without an answer, until one is given.
    fn route(&mut self, address: &str) -> &mut Page {
        let (address, answer) = (address.to_owned(), "void".to_owned());
        self.routes.push(Route { address, query: None, body: None, answer });
        self
    }

    fn newest(&mut self) -> &mut Route {
        self.routes.last_mut().unwrap()
    }

    fn asks<T: JsonSchema>(&mut self) -> &mut Page {
        let query = typed(self.sent.subschema_for::<T>().as_value());
        self.newest().query = Some(query);
        self
    }

    fn takes<T: JsonSchema>(&mut self) -> &mut Page {
        let body = typed(self.sent.subschema_for::<T>().as_value());
        self.newest().body = Some(body);
        self
    }

    fn takes_file(&mut self) -> &mut Page {
        "string | Blob".clone_into(self.newest().body.get_or_insert_default());
        self
    }

    fn gives<T: JsonSchema>(&mut self) -> &mut Page {
        let answer = typed(self.got.subschema_for::<T>().as_value());
        self.newest().answer = answer;
        self
    }

    fn gives_file(&mut self) -> &mut Page {
        "Blob".clone_into(&mut self.newest().answer);
        self
    }

    fn finish(mut self) -> String {
        let got = declarations(&self.got.take_definitions(false));
        let sent = declarations(&self.sent.take_definitions(false));
        let mut all = sent;
        for (name, text) in got.declared {
            // A type that is sent and received has the optional fields of the sent one.
            if SENT_WHOLE.contains(&name.as_str()) || !all.declared.contains_key(&name) {
                all.declared.insert(name, text);
            }
        }
        all.inlined.extend(got.inlined);
        let mut out = HEAD.to_owned();
        for text in all.declared.values() {
            out.push('\n');
            out.push_str(text);
        }
        out.push_str("\n/** Requests over HTTP: what each takes and what comes back. */\n");
        out.push_str("export interface Routes {\n");
        for Route { address, query, body, answer } in &self.routes {
            let part = |name: &str, of: &Option<String>| {
                of.as_ref().map(|t| format!("{name}: {t}; ")).unwrap_or_default()
            };
            let (query, body) = (part("query", query), part("body", body));
            writeln!(out, "  \"{address}\": {{ {query}{body}answer: {answer} }};").unwrap();
        }
        out.push_str("}\n");
        out.push_str(TAIL);
        all.resolve(&out)
    }
}

/// Rendered types by name.
struct Declarations {
    declared: BTreeMap<String, String>,
    /// Types that are written out at each use: names for plain numbers, texts, rows.
    inlined: BTreeMap<String, String>,
}

impl Declarations {
    /// Writes out types without a declaration of their own; see [`typed`] for the marks.
    fn resolve(&self, text: &str) -> String {
        let mut text = text.to_owned();
        // A row is of numbers that have a name, too.
        for _ in 0..3 {
            for (name, of) in &self.inlined {
                text = text.replace(&format!("\u{1}{name}\u{2}"), of);
            }
        }
        let text = text.replace(['\u{1}', '\u{2}'], "");
        // A part that turned out to be a single name needs no brackets.
        let mut plain = String::new();
        let mut rest = text.as_str();
        while let Some((before, after)) = rest.split_once('(') {
            let (inside, _) = after.split_once(')').unwrap_or((after, ""));
            let one = inside.chars().all(|c| c.is_ascii_alphanumeric());
            plain.push_str(before);
            rest = after;
            if one && after[inside.len()..].starts_with(")[]") {
                plain.push_str(inside);
                rest = &after[inside.len() + 1..];
            } else {
                plain.push('(');
            }
        }
        plain + rest
    }
}

fn declarations(definitions: &Map<String, Value>) -> Declarations {
    let mut found = Declarations { declared: BTreeMap::new(), inlined: BTreeMap::new() };
    for (name, schema) in definitions {
        let object = schema.get("properties").is_some();
        let choice = ["oneOf", "anyOf", "enum", "const"].iter().any(|k| schema.get(*k).is_some());
        if object && !is_choice(schema) && schema.get("$ref").is_none() {
            let text = format!(
                "{}export interface {name} {{\n{}}}\n",
                described(schema, ""),
                members(schema)
            );
            found.declared.insert(name.clone(), text);
        } else if choice {
            let text =
                format!("{}export type {name} ={};\n", described(schema, ""), alternatives(schema));
            found.declared.insert(name.clone(), text);
        } else {
            found.inlined.insert(name.clone(), typed(schema));
        }
    }
    found
}

/// Whether a schema with properties is one alternative of several, not an object to which `oneOf`
/// adds rules.
fn is_choice(schema: &Value) -> bool {
    let all = |key: &str| {
        schema
            .get(key)
            .and_then(Value::as_array)
            .is_some_and(|c| c.iter().any(|c| c.get("type").is_some() || c.get("$ref").is_some()))
    };
    all("oneOf") || all("anyOf")
}

/// The doc comment of a type or a field, without the paths of Rust, which tools for TypeScript do
/// not know.
fn described(schema: &Value, indent: &str) -> String {
    let Some(text) = schema.get("description").and_then(Value::as_str) else {
        return String::new();
    };
    let mut plain = String::new();
    let mut rest = text;
    // [`Path::To`](path) becomes `Path::To`.
    while let Some(at) = rest.find("[`") {
        plain.push_str(&rest[..at]);
        rest = &rest[at + 1..];
        let end = rest.find(']').unwrap();
        plain.push_str(&rest[..end]);
        rest = &rest[end + 1..];
        if rest.starts_with('(') {
            rest = &rest[rest.find(')').unwrap() + 1..];
        }
    }
    plain.push_str(rest);
    let plain = plain.replace("`None`", "null");
    let lines: Vec<&str> = plain.lines().collect();
    match lines.as_slice() {
        [one] => format!("{indent}/** {one} */\n"),
        lines => {
            let lines: String = lines
                .iter()
                .map(|l| format!("{indent} * {l}").trim_end().to_owned() + "\n")
                .collect();
            format!("{indent}/**\n{lines}{indent} */\n")
        }
    }
}

/// The members of an object, a line each.
fn members(schema: &Value) -> String {
    let mut text = String::new();
    for (name, of, sure) in properties(schema) {
        let mark = if sure { "" } else { "?" };
        let of_type = member_type(of, sure);
        writeln!(text, "{}  {name}{mark}: {of_type};", described(of, "  ")).unwrap();
    }
    text
}

/// Name, schema and whether it is always there.
fn properties(schema: &Value) -> Vec<(&String, &Value, bool)> {
    let required: BTreeSet<&str> = schema
        .get("required")
        .and_then(Value::as_array)
        .map(|r| r.iter().filter_map(Value::as_str).collect())
        .unwrap_or_default();
    let all = schema.get("properties").and_then(Value::as_object);
    all.into_iter().flatten().map(|(n, s)| (n, s, required.contains(n.as_str()))).collect()
}

/// An optional member is absent instead of null, except if both have a meaning.
fn member_type(schema: &Value, sure: bool) -> String {
    let text = typed(schema);
    let nullable = schema.get("x-null").is_some();
    match (sure || nullable, text.strip_suffix(" | null")) {
        (false, Some(plain)) => plain.to_owned(),
        (true, None) if nullable => format!("{text} | null"),
        _ => text,
    }
}

/// The alternatives of an enum, a line each where they are objects or have docs of their own.
fn alternatives(schema: &Value) -> String {
    let listed = ["oneOf", "anyOf"].iter().find_map(|k| schema.get(*k)?.as_array());
    let Some(listed) = listed else { return format!(" {}", typed(schema)) };
    let lines = listed.iter().map(|s| {
        let docs = described(s, "  ");
        format!("\n{docs}  | {}", typed(s))
    });
    lines.collect()
}

/// A schema as a TypeScript type. A named type is enclosed in two marks, so that it can be written
/// out later if it has no declaration.
fn typed(schema: &Value) -> String {
    let Some(schema) = schema.as_object() else { return "Json".to_owned() };
    let one = |key: &str| schema.get(key);
    if let Some(list) = one("oneOf").or_else(|| one("anyOf")).and_then(Value::as_array)
        && is_choice(&Value::Object(schema.clone()))
    {
        let parts: Vec<String> = list.iter().map(typed).collect();
        return joined(parts);
    }
    if let Some(constant) = one("const") {
        return constant.to_string();
    }
    if let Some(list) = one("enum").and_then(Value::as_array) {
        return joined(list.iter().map(Value::to_string).collect());
    }
    let reference = one("$ref").and_then(Value::as_str).map(|r| {
        let name = r.rsplit('/').next().unwrap();
        format!("\u{1}{name}\u{2}")
    });
    let own = one("properties").map(|_| inline(&Value::Object(schema.clone())));
    match (reference, own) {
        (Some(name), Some(own)) => return format!("({own} & {name})"),
        (Some(name), None) => return name,
        (None, Some(own)) => return own,
        (None, None) => {}
    }
    let kinds: Vec<&str> = match one("type") {
        Some(Value::String(kind)) => vec![kind],
        Some(Value::Array(kinds)) => kinds.iter().filter_map(Value::as_str).collect(),
        _ => return "Json".to_owned(),
    };
    joined(kinds.iter().map(|kind| plain(kind, schema)).collect())
}

fn joined(mut parts: Vec<String>) -> String {
    parts.dedup();
    // Last, so that it can be taken off.
    parts.sort_by_key(|p| p == "null");
    parts.join(" | ")
}

/// `{ a: X; b?: Y }`.
fn inline(schema: &Value) -> String {
    let mut all = properties(schema);
    // The member that distinguishes the alternatives of a type stands first.
    all.sort_by_key(|(name, ..)| !matches!(name.as_str(), "event" | "op"));
    let parts: Vec<String> = all
        .into_iter()
        .map(|(name, of, sure)| {
            let mark = if sure { "" } else { "?" };
            format!("{name}{mark}: {}", member_type(of, sure))
        })
        .collect();
    if parts.is_empty() { none() } else { format!("{{ {} }}", parts.join("; ")) }
}

/// An object without members.
fn none() -> String {
    "Record<string, never>".to_owned()
}

fn plain(kind: &str, schema: &Map<String, Value>) -> String {
    match kind {
        "integer" | "number" => "number".to_owned(),
        "boolean" | "string" | "null" => kind.to_owned(),
        "array" => array(schema),
        "object" => match schema.get("additionalProperties") {
            Some(Value::Bool(false)) => none(),
            Some(of) => format!("Record<string, {}>", typed(of)),
            None => "Record<string, Json>".to_owned(),
        },
        other => panic!("{other} has no type in TypeScript"),
    }
}

fn array(schema: &Map<String, Value>) -> String {
    if let Some(parts) = schema.get("prefixItems").and_then(Value::as_array) {
        let parts: Vec<String> = parts.iter().map(typed).collect();
        return format!("[{}]", parts.join(", "));
    }
    let item = schema.get("items").map_or_else(|| "Json".to_owned(), typed);
    let bound = |key: &str| schema.get(key).and_then(Value::as_u64);
    match (bound("minItems"), bound("maxItems")) {
        (Some(n), Some(m)) if n == m && n <= 4 => {
            format!("[{}]", vec![item; n as usize].join(", "))
        }
        _ if item.contains(" | ") || item.starts_with('\u{1}') => format!("({item})[]"),
        _ => format!("{item}[]"),
    }
}
