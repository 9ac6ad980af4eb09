//! No two files import each other, directly or through others: whoever reads a file can read
//! what it stands on first. A circle that has a reason is listed with it in `ARCHITECTURE.md`.
//!
//! An import is a name that one file takes from another, through `use` or a path; a name that a
//! parent module passes on (`pub use`) counts as taken from the file that defines it. Tests may
//! use what they like.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use super::floors::{walk, walk_named};

/// Folders inside which circles stay, each with its reason in `ARCHITECTURE.md`.
const CIRCLES: &[&str] = &["src/linalg"];

type Graph = BTreeMap<String, BTreeSet<String>>;

#[test]
fn files_import_each_other_in_no_circle() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let src = root.join("src");
    let mut graph = Graph::new();
    for manifest in walk_named(&src, "Cargo.toml") {
        let folder = manifest.parent().unwrap();
        let inside = folder.strip_prefix(root).unwrap();
        graph.extend(Crate::read(folder, inside).graph());
    }
    graph.extend(Crate::read(&src, Path::new("src")).graph());
    graph.extend(page(&root.join("ui/src")));
    let found = circles(&graph);
    let inside =
        |circle: &BTreeSet<String>, folder: &str| circle.iter().all(|f| f.starts_with(folder));
    let show = |circle: &BTreeSet<String>| {
        let imports = |f: &String| {
            let to = graph[f].intersection(circle).cloned().collect::<Vec<_>>();
            format!("    {f} -> {}", to.join(", "))
        };
        circle.iter().map(imports).collect::<Vec<_>>().join("\n")
    };
    let new = found.iter().filter(|c| !CIRCLES.iter().any(|folder| inside(c, folder)));
    let new: Vec<String> = new.map(show).collect();
    assert!(new.is_empty(), "files that import each other in a circle:\n{}", new.join("\n\n"));
    for folder in CIRCLES {
        let known = found.iter().any(|c| inside(c, folder));
        assert!(known, "no circle in {folder} any more: take it off the list");
    }
}

/// The imports of the page's TypeScript files.
fn page(src: &Path) -> Graph {
    let mut graph = Graph::new();
    let mut folders = vec![src.to_owned()];
    while let Some(dir) = folders.pop() {
        for entry in fs::read_dir(&dir).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "ts" || e == "tsx") {
                let text = fs::read_to_string(&path).unwrap();
                let parts = text.split(" from \"").skip(1);
                let named = parts.filter_map(|rest| rest.split('"').next());
                let files = named.filter(|n| n.starts_with('.')).filter_map(|name| {
                    let base = dir.join(name);
                    let with = |end: &str| PathBuf::from(format!("{}{end}", base.display()));
                    let found = ["", ".ts", ".tsx", "/index.ts"].iter().map(|end| with(end));
                    let found = found.filter(|p| p.is_file()).find_map(|p| p.canonicalize().ok());
                    assert!(
                        found.is_some() || Path::new(name).extension().is_some_and(|e| e == "css"),
                        "{}: {name}",
                        path.display()
                    );
                    found.filter(|p| p.starts_with(src.canonicalize().unwrap()))
                });
                let short = |p: &Path| {
                    let src = src.canonicalize().unwrap();
                    format!("ui/src/{}", p.strip_prefix(src).unwrap().display())
                };
                let own = path.canonicalize().unwrap();
                graph.insert(short(&own), files.map(|p| short(&p)).collect());
            }
        }
    }
    graph
}

/// Sets of files of which each reaches each other.
fn circles(graph: &Graph) -> BTreeSet<BTreeSet<String>> {
    let reach: BTreeMap<&String, BTreeSet<&String>> = graph
        .keys()
        .map(|from| {
            let (mut seen, mut next) = (BTreeSet::new(), vec![from]);
            while let Some(at) = next.pop() {
                for to in graph.get(at).into_iter().flatten() {
                    if seen.insert(to) {
                        next.push(to);
                    }
                }
            }
            (from, seen)
        })
        .collect();
    let both = |a: &String, b: &String| reach[a].contains(b) && reach[b].contains(a);
    let circle = |a: &String| graph.keys().filter(|b| both(a, b)).cloned().collect();
    graph.keys().map(circle).filter(|c: &BTreeSet<String>| c.len() > 1).collect()
}

/// The modules of a crate by their path (`net::mat`; the root is empty).
struct Crate {
    modules: BTreeMap<Vec<String>, Module>,
}

#[derive(Default)]
struct Module {
    file: String,
    /// Names that this module takes from elsewhere: alias, path as written, whether passed on.
    uses: Vec<Use>,
    /// Paths in the code itself.
    paths: Vec<Vec<String>>,
    /// Names in the code, outside of `use`.
    words: BTreeSet<String>,
    /// Items that are defined here.
    items: BTreeSet<String>,
    /// Only compiled for tests.
    test: bool,
    /// Child modules that are only compiled for tests.
    test_children: BTreeSet<String>,
}

struct Use {
    alias: String,
    path: Vec<String>,
    public: bool,
}

impl Crate {
    /// Reads the crate whose root is in the folder `src`, without crates in folders of it; `folder`
    /// is what its files are called.
    fn read(src: &Path, folder: &Path) -> Crate {
        let mut modules = BTreeMap::new();
        let others: Vec<PathBuf> = walk_named(src, "Cargo.toml")
            .into_iter()
            .filter_map(|m| m.parent().map(Path::to_owned))
            .filter(|dir| dir != src)
            .collect();
        for path in walk(src).iter().filter(|p| !others.iter().any(|dir| p.starts_with(dir))) {
            let inside = path.strip_prefix(src).unwrap();
            let mut name: Vec<String> =
                inside.with_extension("").iter().map(|s| s.to_str().unwrap().to_owned()).collect();
            if name == ["main"] || name == ["build"] {
                continue;
            }
            if name == ["lib"] || name.last().is_some_and(|l| l == "mod") {
                name.pop();
            }
            let mut module = Module::parse(&fs::read_to_string(path).unwrap());
            module.file = folder.join(inside).display().to_string();
            modules.insert(name, module);
        }
        let tests: Vec<Vec<String>> = modules
            .iter()
            .flat_map(|(name, m)| {
                m.test_children.iter().map(|c| [&name[..], std::slice::from_ref(c)].concat())
            })
            .collect();
        for name in tests {
            if let Some(module) = modules.get_mut(&name) {
                module.test = true;
            }
        }
        Crate { modules }
    }

    fn graph(&self) -> Graph {
        let mut graph = Graph::new();
        for (name, module) in self.modules.iter().filter(|(_, m)| !m.test) {
            let to = graph.entry(module.file.clone()).or_default();
            for u in &module.uses {
                if !u.public || module.words.contains(&u.alias) {
                    to.extend(self.target(name, &u.path, 0));
                }
            }
            for path in &module.paths {
                to.extend(self.target(name, path, 0));
            }
            to.remove(&module.file);
        }
        graph
    }

    /// The file that defines what a path of this module means; none for other crates.
    fn target(&self, from: &[String], path: &[String], depth: usize) -> Option<String> {
        if depth > 8 {
            return None;
        }
        let (first, mut rest) = path.split_first()?;
        let mut at: Vec<String> = match first.as_str() {
            "crate" => Vec::new(),
            "self" => from.to_vec(),
            "super" => from[..from.len().checked_sub(1)?].to_vec(),
            _ => {
                let child = [from, std::slice::from_ref(first)].concat();
                if self.modules.contains_key(&child) {
                    child
                } else {
                    return None;
                }
            }
        };
        while let Some((name, after)) = rest.split_first() {
            let child = [&at[..], std::slice::from_ref(name)].concat();
            if name == "super" {
                at.pop();
            } else if self.modules.contains_key(&child) {
                at = child;
            } else {
                let module = self.modules.get(&at)?;
                if module.items.contains(name) {
                    break;
                }
                let passed = module.uses.iter().find(|u| u.alias == *name);
                if let Some(u) = passed {
                    let path = [&u.path[..], after].concat();
                    return self.target(&at, &path, depth + 1);
                }
                let mut globs = module.uses.iter().filter(|u| u.alias == "*");
                let found = globs.find_map(|u| {
                    let mut path = u.path.clone();
                    path.pop();
                    path.push(name.clone());
                    self.target(&at, &path, depth + 1)
                });
                return found.or_else(|| Some(module.file.clone()));
            }
            rest = after;
        }
        self.modules.get(&at).map(|m| m.file.clone())
    }
}

impl Module {
    fn parse(text: &str) -> Module {
        let tokens = tokens(text);
        let mut module = Module::default();
        let (mut i, mut public) = (0, false);
        let is = |i: usize, t: &str| tokens.get(i).is_some_and(|x| x == t);
        let word = |i: usize| tokens.get(i).filter(|t| named(t)).cloned();
        while i < tokens.len() {
            let token = tokens[i].as_str();
            match token {
                "#" if tokens[i..]
                    .starts_with(&["#", "[", "cfg", "(", "test", ")", "]"].map(str::to_owned)) =>
                {
                    i += 7;
                    let mut at = i;
                    while is(at, "#") {
                        at = after(&tokens, at + 1);
                    }
                    while is(at, "pub") || is(at, "(") {
                        at = if is(at, "(") { after(&tokens, at) } else { at + 1 };
                    }
                    if is(at, "mod") {
                        module.test_children.extend(word(at + 1));
                    }
                    // The item ends with its block or with a semicolon before one.
                    while at < tokens.len() && !is(at, ";") && !is(at, "{") {
                        at += 1;
                    }
                    i = if is(at, "{") { after(&tokens, at) } else { at + 1 };
                    continue;
                }
                "pub" => {
                    public = true;
                    i += 1;
                    if is(i, "(") {
                        i = after(&tokens, i);
                    }
                    continue;
                }
                "use" => {
                    let mut end = i + 1;
                    while !is(end, ";") {
                        end += 1;
                    }
                    tree(&tokens[i + 1..end], &[], public, &mut module.uses);
                    i = end;
                }
                // A declaration is no use of what it declares.
                "mod" => i += 1,
                "fn" | "struct" | "enum" | "trait" | "type" | "const" | "static" | "union"
                | "macro_rules" => {
                    let at = if is(i + 1, "!") { i + 2 } else { i + 1 };
                    module.items.extend(word(at));
                }
                _ if named(token) => {
                    module.words.insert(token.to_owned());
                    // The beginning of a path.
                    if is(i + 1, "::") && (i == 0 || tokens[i - 1] != "::") {
                        let mut path = vec![token.to_owned()];
                        while is(i + 1, "::") {
                            let Some(next) = word(i + 2) else { break };
                            module.words.insert(next.clone());
                            path.push(next);
                            i += 2;
                        }
                        module.paths.push(path);
                    }
                }
                _ => {}
            }
            public = false;
            i += 1;
        }
        module
    }
}

fn named(token: &str) -> bool {
    token.starts_with(|c: char| c.is_alphabetic() || c == '_')
}

/// The index after the bracket that closes the one at `at`.
fn after(tokens: &[String], at: usize) -> usize {
    let mut depth = 0;
    for (i, token) in tokens.iter().enumerate().skip(at) {
        match token.as_str() {
            "{" | "(" | "[" => depth += 1,
            "}" | ")" | "]" => {
                depth -= 1;
                if depth == 0 {
                    return i + 1;
                }
            }
            _ => {}
        }
    }
    tokens.len()
}

/// The paths of a `use` tree, each with its alias.
fn tree(tokens: &[String], before: &[String], public: bool, to: &mut Vec<Use>) {
    let mut path = before.to_vec();
    let mut i = 0;
    while i < tokens.len() {
        match tokens[i].as_str() {
            "{" => {
                let inside = &tokens[i + 1..after(tokens, i) - 1];
                let (mut start, mut depth) = (0, 0);
                for (at, token) in inside.iter().enumerate() {
                    match token.as_str() {
                        "{" => depth += 1,
                        "}" => depth -= 1,
                        "," if depth == 0 => {
                            tree(&inside[start..at], &path, public, to);
                            start = at + 1;
                        }
                        _ => {}
                    }
                }
                return tree(&inside[start..], &path, public, to);
            }
            "as" => {
                let alias = tokens[i + 1].clone();
                return to.push(Use { alias, path, public });
            }
            "::" => {}
            "self" if !path.is_empty() => {}
            part => path.push(part.to_owned()),
        }
        i += 1;
    }
    if let (false, Some(alias)) = (tokens.is_empty(), path.last().cloned()) {
        to.push(Use { alias, path, public });
    }
}

/// Names, `::` and single signs; comments, strings and numbers are left out.
fn tokens(text: &str) -> Vec<String> {
    let chars: Vec<char> = text.chars().collect();
    let at = |i: usize| chars.get(i).copied().unwrap_or('\0');
    let mut found = Vec::new();
    let mut i = 0;
    while i < chars.len() {
        let c = chars[i];
        if c == '/' && at(i + 1) == '/' {
            while i < chars.len() && chars[i] != '\n' {
                i += 1;
            }
        } else if c == '/' && at(i + 1) == '*' {
            while i < chars.len() && !(chars[i] == '*' && at(i + 1) == '/') {
                i += 1;
            }
            i += 2;
        } else if c == '"' {
            i += 1;
            while i < chars.len() && chars[i] != '"' {
                i += if chars[i] == '\\' { 2 } else { 1 };
            }
            i += 1;
        } else if c == '\'' {
            // A character, or a lifetime.
            if at(i + 1) == '\\' {
                i += 3;
                while i < chars.len() && chars[i] != '\'' {
                    i += 1;
                }
                i += 1;
            } else if at(i + 2) == '\'' {
                i += 3;
            } else {
                i += 1;
                while at(i).is_alphanumeric() || at(i) == '_' {
                    i += 1;
                }
            }
        } else if c.is_alphabetic() || c == '_' {
            let start = i;
            while at(i).is_alphanumeric() || at(i) == '_' {
                i += 1;
            }
            let name: String = chars[start..i].iter().collect();
            if matches!(name.as_str(), "r" | "br") && matches!(at(i), '"' | '#') {
                let mut marks = 0;
                while at(i) == '#' {
                    marks += 1;
                    i += 1;
                }
                let end: String = format!("\"{}", "#".repeat(marks));
                let rest: String = chars[i + 1..].iter().collect();
                let length = rest.find(&end).map_or(rest.len(), |b| rest[..b].chars().count());
                i += 1 + length + end.len();
            } else {
                found.push(name);
            }
        } else if c == ':' && at(i + 1) == ':' {
            found.push("::".to_owned());
            i += 2;
        } else if c.is_ascii_digit() {
            while at(i).is_alphanumeric() || at(i) == '_' {
                i += 1;
            }
        } else {
            if !c.is_whitespace() {
                found.push(c.to_string());
            }
            i += 1;
        }
    }
    found
}

#[test]
fn circles_and_what_is_passed_on_are_found() {
    let dir = tempfile::tempdir().unwrap();
    let put = |name: &str, text: &str| {
        let path = dir.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    };
    put("lib.rs", "mod a; mod b; mod c;");
    put(
        "a/mod.rs",
        "mod deep;\n#[cfg(test)]\nmod check;\npub use deep::Deep;\npub use crate::c::C as See;",
    );
    // Through `pub use`, an alias and a group; in a comment, a string and a test nothing counts.
    put("a/deep.rs", "use crate::b::{self, Other};\npub struct Deep;");
    put("a/check.rs", "use crate::b::Other;");
    put("b.rs", "pub struct Other;\nfn f(x: crate::a::Deep) {}");
    put(
        "c.rs",
        "// crate::b::Other\npub struct C;\nconst S: &str = r#\"crate::b::f\"#;\n#[cfg(test)]\nmod tests { use crate::a::See; }",
    );
    let graph = Crate::read(dir.path(), Path::new("src")).graph();
    let set = |names: &[&str]| names.iter().map(|n| (*n).to_owned()).collect::<BTreeSet<_>>();
    assert_eq!(graph["src/a/deep.rs"], set(&["src/b.rs"]));
    assert_eq!(graph["src/b.rs"], set(&["src/a/deep.rs"]));
    assert_eq!(graph["src/a/mod.rs"], set(&[]));
    assert_eq!(graph["src/c.rs"], set(&[]));
    assert!(!graph.contains_key("src/a/check.rs"));
    assert_eq!(circles(&graph), BTreeSet::from([set(&["src/a/deep.rs", "src/b.rs"])]));
}
