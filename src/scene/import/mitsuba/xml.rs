//! XML to objects with properties: parameters are substituted, files included, names of files looked up.
//!
//! What an object means is up to those who ask it for its properties. It notes which they asked for, so that what nobody
//! reads is told.

use std::{
    cell::Cell,
    collections::HashMap,
    path::{Path, PathBuf},
    rc::Rc,
};

use glam::{DAffine3, DMat3, DMat4, DVec3};
use roxmltree::{Node, ParsingOptions};

use super::spectra::Spectrum;
use crate::scene::{
    error::{Location, SceneError},
    import::FARTHEST,
    sources::{Sources, Warning},
    text::{excerpt, file_name, foreign, number, one_line},
};

/// Elements that are objects, made by the plugin that their `type` names.
const OBJECTS: &[&str] = &[
    "bsdf",
    "emitter",
    "film",
    "integrator",
    "medium",
    "phase",
    "rfilter",
    "sampler",
    "scene",
    "sensor",
    "shape",
    "texture",
    "volume",
];

/// Elements stand in at most so many others.
const DEEPEST: u32 = 64;
/// Files are included by at most so many others in a row, as Mitsuba has it, and so often in all.
const LONGEST_INCLUSION: usize = 15;
const MOST_INCLUSIONS: usize = 4096;
/// Elements of one file.
const MOST_NODES: u32 = 1 << 26;

/// All objects of a scene. The first is the scene itself.
#[derive(Debug)]
pub(super) struct Document {
    pub objects: Vec<Object>,
}

/// What a plugin makes.
#[derive(Debug)]
pub(super) struct Object {
    /// Its element, as `shape`; `texture` for a `spectrum` that has a type.
    pub tag: &'static str,
    /// Its type, as `sphere`.
    pub plugin: String,
    pub id: Option<String>,
    pub location: Location,
    /// Where the files that it names are looked for, in this order.
    folders: Rc<[PathBuf]>,
    /// In the order of the file.
    properties: Vec<Property>,
    /// Whether anybody asked for its properties.
    is_used: Cell<bool>,
}

#[derive(Debug)]
struct Property {
    /// Empty for objects without.
    name: String,
    location: Location,
    value: Value,
    is_used: Cell<bool>,
}

/// The value of a property.
#[derive(Debug)]
pub(super) enum Value {
    Float(f64),
    Integer(i64),
    Boolean(bool),
    Text(String),
    Vector(DVec3),
    Rgb(DVec3),
    Spectrum(Spectrum),
    Transform(DMat4),
    /// An object by its place.
    Object(usize),
    /// An object by its id, which may stand further down.
    Reference(String),
}

impl Value {
    fn kind(&self) -> &'static str {
        match self {
            Self::Float(_) => "float",
            Self::Integer(_) => "integer",
            Self::Boolean(_) => "boolean",
            Self::Text(_) => "string",
            Self::Vector(_) => "vector",
            Self::Rgb(_) => "rgb",
            Self::Spectrum(_) => "spectrum",
            Self::Transform(_) => "transform",
            Self::Object(_) | Self::Reference(_) => "object",
        }
    }
}

/// Values of `$names`.
pub(super) type Parameters = Vec<(String, String)>;

/// Reads a scene with the files that it includes. Its defaults give way to `parameters`.
pub(super) fn read(path: &Path, mut parameters: Parameters, sources: &mut Sources) -> Result<Document, SceneError> {
    parameters.sort_by_key(|(name, _)| std::cmp::Reverse(name.len()));
    let mut reader =
        Reader { sources, objects: Vec::new(), ids: HashMap::new(), parameters, open: Vec::new(), included: 0 };
    reader.file(path, &Location::file(path), &[], None)?;
    let Reader { mut objects, ids, .. } = reader;
    for object in &mut objects {
        for property in &mut object.properties {
            if let Value::Reference(id) = &property.value {
                let Some(place) = ids.get(id) else {
                    let problem = format!("nothing has the id `{}`; define it, or correct the name", excerpt(id));
                    return Err(property.location.refuse(problem));
                };
                property.value = Value::Object(*place);
            }
        }
    }
    Ok(Document { objects })
}

impl Document {
    /// The objects that an object holds.
    pub fn children<'a>(&'a self, parent: &'a Object) -> impl Iterator<Item = usize> {
        parent.is_used.set(true);
        parent.properties.iter().filter_map(|property| match property.value {
            Value::Object(place) => {
                property.is_used.set(true);
                Some(place)
            }
            _ => None,
        })
    }

    /// Those of an element.
    pub fn children_of<'a>(&'a self, parent: &'a Object, tag: &'static str) -> impl Iterator<Item = usize> {
        parent.is_used.set(true);
        parent.properties.iter().filter_map(move |property| match property.value {
            Value::Object(place) if self.objects[place].tag == tag => {
                property.is_used.set(true);
                Some(place)
            }
            _ => None,
        })
    }

    /// Notes properties that nobody asked for, of objects that somebody did.
    pub fn note_unused(&self, sources: &mut Sources) {
        for object in self.objects.iter().filter(|object| object.is_used.get()) {
            for property in object.properties.iter().filter(|property| !property.is_used.get()) {
                let Object { tag, plugin, .. } = object;
                let what = match &property.value {
                    Value::Object(place) if property.name.is_empty() => {
                        let child = &self.objects[*place];
                        format!("{} `{}`", child.tag, excerpt(&child.plugin))
                    }
                    _ => format!("`{}`", excerpt(&property.name)),
                };
                let text = format!("{what} has no effect on {tag} `{}`", excerpt(plugin));
                sources.note(&Warning { kind: "unused property", location: property.location.clone(), text });
            }
        }
    }
}

impl Object {
    /// What to call it in messages: its id or its type.
    pub fn name(&self) -> &str {
        self.id.as_deref().unwrap_or(&self.plugin)
    }

    /// A property, and where it stands.
    pub fn value(&self, name: &str) -> Option<(&Value, &Location)> {
        self.is_used.set(true);
        let property = self.properties.iter().find(|property| property.name == name)?;
        property.is_used.set(true);
        Some((&property.value, &property.location))
    }

    pub fn has(&self, name: &str) -> bool {
        self.properties.iter().any(|property| property.name == name)
    }

    /// Whether a property makes no difference here, whatever it is.
    pub fn ignore(&self, names: &[&str]) {
        self.is_used.set(true);
        self.properties.iter().filter(|p| names.contains(&&*p.name)).for_each(|property| property.is_used.set(true));
    }

    /// That a property is of another kind than it is to be.
    fn mismatch(&self, name: &str, value: &Value, location: &Location, wanted: &str) -> SceneError {
        location.refuse(format!("`{name}` of {} is a {}; give a {wanted}", excerpt(&self.plugin), value.kind()))
    }

    pub fn float(&self, name: &str, default: f64) -> Result<f64, SceneError> {
        match self.value(name) {
            None => Ok(default),
            Some((Value::Float(value), _)) => Ok(*value),
            Some((Value::Integer(value), _)) => Ok(*value as f64),
            Some((value, location)) => Err(self.mismatch(name, value, location, "float")),
        }
    }

    /// A number in a range.
    pub fn float_in(
        &self,
        name: &str,
        default: f64,
        range: impl std::ops::RangeBounds<f64>,
        words: &str,
    ) -> Result<f64, SceneError> {
        let value = self.float(name, default)?;
        match range.contains(&value) {
            true => Ok(value),
            false => Err(self.at(name).refuse(format!("`{name}` is {value}; give {words}"))),
        }
    }

    pub fn integer(&self, name: &str, default: i64) -> Result<i64, SceneError> {
        match self.value(name) {
            None => Ok(default),
            Some((Value::Integer(value), _)) => Ok(*value),
            Some((value, location)) => Err(self.mismatch(name, value, location, "integer")),
        }
    }

    pub fn boolean(&self, name: &str, default: bool) -> Result<bool, SceneError> {
        match self.value(name) {
            None => Ok(default),
            Some((Value::Boolean(value), _)) => Ok(*value),
            Some((value, location)) => Err(self.mismatch(name, value, location, "boolean")),
        }
    }

    pub fn text(&self, name: &str) -> Result<Option<&str>, SceneError> {
        match self.value(name) {
            None => Ok(None),
            Some((Value::Text(text), _)) => Ok(Some(text)),
            Some((value, location)) => Err(self.mismatch(name, value, location, "string")),
        }
    }

    /// One of some words; the first is the default.
    pub fn choice(&self, name: &str, words: &[&'static str]) -> Result<&'static str, SceneError> {
        let Some(text) = self.text(name)? else { return Ok(words[0]) };
        words.iter().find(|word| text.eq_ignore_ascii_case(word)).copied().ok_or_else(|| {
            self.at(name).refuse(format!("no {name} `{}`; take one of {}", excerpt(text), words.join(", ")))
        })
    }

    pub fn vector(&self, name: &str) -> Result<Option<DVec3>, SceneError> {
        match self.value(name) {
            None => Ok(None),
            Some((Value::Vector(value), _)) => Ok(Some(*value)),
            Some((value, location)) => Err(self.mismatch(name, value, location, "vector")),
        }
    }

    /// A transform of space, perhaps a singular one.
    pub fn transform(&self, name: &str) -> Result<Option<DAffine3>, SceneError> {
        let Some(matrix) = self.matrix(name)? else { return Ok(None) };
        let bottom = matrix.row(3);
        if (bottom - glam::DVec4::W).abs().max_element() > 1e-6 {
            return Err(self.at(name).refuse(format!("`{name}` is no affine map; let its last row be 0 0 0 1")));
        }
        Ok(Some(DAffine3::from_mat4(matrix)))
    }

    /// A matrix of 4 x 4.
    pub fn matrix(&self, name: &str) -> Result<Option<DMat4>, SceneError> {
        match self.value(name) {
            None => Ok(None),
            Some((Value::Transform(value), _)) => Ok(Some(*value)),
            Some((value, location)) => Err(self.mismatch(name, value, location, "transform")),
        }
    }

    /// Where a property stands, or the object if it has none of that name.
    pub fn at(&self, name: &str) -> &Location {
        let property = self.properties.iter().find(|property| property.name == name);
        property.map_or(&self.location, |property| &property.location)
    }

    /// The file that it names by `filename`, which it must.
    pub fn file(&self, sources: &Sources) -> Result<PathBuf, SceneError> {
        match self.text("filename")? {
            Some(name) => Ok(find(name, &self.folders, sources)),
            None => Err(self.location.refuse(format!("{} `{}` names no file; give a filename", self.tag, self.plugin))),
        }
    }
}

/// A file in the first folder that has it; where none has, in the first.
fn find(name: &str, folders: &[PathBuf], sources: &Sources) -> PathBuf {
    let name = file_name(name);
    let mut candidates = folders.iter().map(|folder| folder.join(&name));
    let first = candidates.next().unwrap_or_else(|| name.clone());
    if sources.has(&first) {
        return first;
    }
    candidates.find(|candidate| sources.has(candidate)).unwrap_or(first)
}

struct Reader<'a, 'b> {
    sources: &'a mut Sources<'b>,
    objects: Vec<Object>,
    ids: HashMap<String, usize>,
    /// The longest names first, so that none is taken for its beginning.
    parameters: Parameters,
    /// Files that are being read, each included by the one before.
    open: Vec<PathBuf>,
    included: usize,
}

/// A file that is being read.
struct File<'a> {
    path: &'a Path,
    /// Offsets of the lines but for the first.
    lines: Vec<usize>,
    folders: Rc<[PathBuf]>,
}

impl File<'_> {
    fn location(&self, node: Node<'_, '_>) -> Location {
        Location::line(self.path, self.lines.partition_point(|&start| start <= node.range().start) + 1)
    }
}

impl Reader<'_, '_> {
    /// Reads a file into its parent; the scene itself has none. Files are looked for in its folder, then in `outer`.
    fn file(
        &mut self,
        path: &Path,
        named_at: &Location,
        outer: &[PathBuf],
        parent: Option<usize>,
    ) -> Result<(), SceneError> {
        if self.open.len() > LONGEST_INCLUSION || self.included > MOST_INCLUSIONS {
            return Err(named_at.refuse("files include each other without end; take this one out"));
        }
        let bytes = self.sources.require(path, named_at)?;
        if let Some(what) = foreign(&bytes) {
            return Err(Location::file(path).refuse(format!("not an XML file but {what}")));
        }
        let text = std::str::from_utf8(&bytes).map_err(|error| {
            let line = 1 + bytes[..error.valid_up_to()].iter().filter(|&&byte| byte == b'\n').count();
            Location::line(path, line).refuse("not UTF-8 text; save the file as UTF-8")
        })?;
        let options = ParsingOptions { allow_dtd: false, nodes_limit: MOST_NODES, ..ParsingOptions::default() };
        let document = roxmltree::Document::parse_with_options(text, options).map_err(|error| {
            let problem = format!("{}; correct the XML", one_line(&error.to_string()));
            Location::line(path, error.pos().row as usize).refuse(problem)
        })?;
        let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
        let folders = std::iter::once(folder).chain(outer.iter().cloned()).collect();
        let lines = text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n').map(|(at, _)| at + 1).collect();
        let mut file = File { path, lines, folders };
        let root = document.root_element();
        let location = file.location(root);
        self.check_version(root, &location)?;
        self.open.push(path.to_path_buf());
        self.included += 1;
        let is_scene = root.tag_name().name() == "scene";
        match parent {
            None if !is_scene => {
                let found = excerpt(root.tag_name().name());
                return Err(location.refuse(format!("a <{found}>, not a <scene>; name a scene of Mitsuba 3")));
            }
            None => {
                self.objects.push(Object {
                    tag: "scene",
                    plugin: "scene".to_owned(),
                    id: None,
                    location,
                    folders: Rc::clone(&file.folders),
                    properties: Vec::new(),
                    is_used: Cell::new(true),
                });
                self.elements(&mut file, root, 0, 0)?;
            }
            Some(parent) if is_scene => self.elements(&mut file, root, parent, 0)?,
            Some(parent) => self.element(&mut file, root, parent, 0)?,
        }
        self.open.pop();
        Ok(())
    }

    /// Versions before 2 spell properties in another way.
    fn check_version(&mut self, root: Node<'_, '_>, location: &Location) -> Result<(), SceneError> {
        let Some(version) = root.attribute("version") else {
            return Err(location.refuse("no version; write <scene version=\"3.0.0\">"));
        };
        let major = version.split('.').next().and_then(|major| major.trim().parse::<u32>().ok());
        match major {
            Some(2..) => Ok(()),
            Some(_) => {
                let problem =
                    "which only Mitsuba 0.x spells so; write it by Mitsuba 3 (mi.parser), or rename its properties";
                Err(location.refuse(format!("version {}, {problem}", excerpt(version))))
            }
            None => {
                let version = excerpt(version);
                Err(location.refuse(format!("`{version}` is not a version; write <scene version=\"3.0.0\">")))
            }
        }
    }

    fn elements(
        &mut self,
        file: &mut File<'_>,
        node: Node<'_, '_>,
        parent: usize,
        depth: u32,
    ) -> Result<(), SceneError> {
        for child in node.children().filter(Node::is_element) {
            self.element(file, child, parent, depth + 1)?;
        }
        Ok(())
    }

    /// Reads an element of an object.
    fn element(
        &mut self,
        file: &mut File<'_>,
        node: Node<'_, '_>,
        parent: usize,
        depth: u32,
    ) -> Result<(), SceneError> {
        let location = file.location(node);
        if depth > DEEPEST {
            return Err(location.refuse("elements stand too deep in each other; give ids and refer to them"));
        }
        let tag = node.tag_name().name();
        let element = Element { node, location: &location };
        let attributes = self.attributes(&element)?;
        let name = attributes.get("name").unwrap_or_default().to_owned();
        let value = match tag {
            "spectrum" if attributes.get("type").is_some() => {
                let place = self.object("texture", file, &element, &attributes, depth)?;
                Value::Object(place)
            }
            "default" => {
                let (name, value) = (attributes.require("name")?, attributes.require("value")?);
                if !self.parameters.iter().any(|(known, _)| known == name) {
                    let place = self.parameters.partition_point(|(known, _)| known.len() >= name.len());
                    self.parameters.insert(place, (name.to_owned(), value.to_owned()));
                }
                return attributes.note_others(&["name", "value"], self.sources);
            }
            "path" => {
                let folder = file_name(attributes.require("value")?);
                let mut folders: Vec<PathBuf> = file.folders.iter().map(|base| base.join(&folder)).collect();
                folders.extend(file.folders.iter().cloned());
                folders.dedup();
                file.folders = folders.into();
                return attributes.note_others(&["value"], self.sources);
            }
            "include" => {
                let path = find(attributes.require("filename")?, &file.folders, self.sources);
                attributes.note_others(&["filename", "name"], self.sources)?;
                return self.file(&path, &location, &file.folders, Some(parent));
            }
            "alias" => {
                let (id, alias) = (attributes.require("id")?, attributes.require("as")?);
                let Some(place) = self.ids.get(id).copied() else {
                    return Err(location.refuse(format!("nothing above has the id `{}`; correct it", excerpt(id))));
                };
                self.name(alias, place, &location)?;
                return attributes.note_others(&["id", "as"], self.sources);
            }
            "ref" => {
                let id = attributes.require("id")?.to_owned();
                attributes.note_others(&["id", "name"], self.sources)?;
                Value::Reference(id)
            }
            "transform" => {
                attributes.note_others(&["name"], self.sources)?;
                Value::Transform(self.transform(file, node)?)
            }
            "vector" | "point" => {
                attributes.note_others(&["name", "value", "x", "y", "z"], self.sources)?;
                Value::Vector(attributes.vector(None)?)
            }
            "spectrum" => {
                attributes.note_others(&["name", "value", "filename"], self.sources)?;
                Value::Spectrum(self.spectrum(file, &attributes)?)
            }
            "float" | "integer" | "boolean" | "string" | "rgb" => {
                let text = attributes.require("value")?;
                attributes.note_others(&["name", "value"], self.sources)?;
                plain_value(tag, text).map_err(|problem| location.refuse(problem))?
            }
            _ => match OBJECTS.iter().find(|known| **known == tag) {
                Some(tag) => Value::Object(self.object(tag, file, &element, &attributes, depth)?),
                None => {
                    let problem = format!("no element <{}> is known here; correct or remove it", excerpt(tag));
                    return Err(location.refuse(problem));
                }
            },
        };
        if name.is_empty() && !matches!(value, Value::Object(_) | Value::Reference(_)) {
            return Err(location.refuse(format!("<{tag}> has no name; name the property that it gives")));
        }
        let properties = &mut self.objects[parent].properties;
        if !name.is_empty() && properties.iter().any(|property| property.name == name) {
            return Err(location.refuse(format!("`{}` is given twice; keep one", excerpt(&name))));
        }
        properties.push(Property { name, location, value, is_used: Cell::new(false) });
        Ok(())
    }

    /// Reads an object with all that it holds.
    fn object(
        &mut self,
        tag: &'static str,
        file: &mut File<'_>,
        element: &Element<'_, '_>,
        attributes: &Attributes,
        depth: u32,
    ) -> Result<usize, SceneError> {
        let plugin = attributes.require("type")?.to_owned();
        let id = attributes.get("id").map(str::to_owned);
        attributes.note_others(&["type", "id", "name", "version"], self.sources)?;
        let place = self.objects.len();
        let location = element.location.clone();
        let folders = Rc::clone(&file.folders);
        if let Some(id) = &id {
            self.name(id, place, &location)?;
        }
        let (properties, is_used) = Default::default();
        self.objects.push(Object { tag, plugin, id, location, folders, properties, is_used });
        self.elements(file, element.node, place, depth)?;
        Ok(place)
    }

    fn name(&mut self, id: &str, place: usize, location: &Location) -> Result<(), SceneError> {
        match self.ids.insert(id.to_owned(), place) {
            None => Ok(()),
            Some(other) => {
                let there = &self.objects[other].location;
                Err(location.refuse(format!("the id `{}` is taken ({there}); choose another", excerpt(id))))
            }
        }
    }

    /// The attributes of an element, parameters substituted.
    fn attributes(&self, element: &Element<'_, '_>) -> Result<Attributes, SceneError> {
        let location = element.location;
        let substituted = |text: &str| substituted(text, &self.parameters).map_err(|problem| location.refuse(problem));
        let pairs = element.node.attributes().map(|attribute| {
            let text = substituted(attribute.value())?;
            Ok((attribute.name().to_owned(), text))
        });
        let tag = element.node.tag_name().name().to_owned();
        Ok(Attributes { tag, location: location.clone(), pairs: pairs.collect::<Result<_, _>>()? })
    }

    fn spectrum(&mut self, file: &File<'_>, attributes: &Attributes) -> Result<Spectrum, SceneError> {
        match (attributes.get("value"), attributes.get("filename")) {
            (Some(value), None) => Spectrum::parse(value).map_err(|problem| attributes.location.refuse(problem)),
            (None, Some(name)) => {
                let path = find(name, &file.folders, self.sources);
                let bytes = self.sources.require(&path, &attributes.location)?;
                let text = String::from_utf8_lossy(&bytes);
                Spectrum::parse_lines(&text).map_err(|(line, problem)| Location::line(&path, line).refuse(problem))
            }
            _ => Err(attributes.location.refuse("a spectrum needs a value or a filename; give one of them")),
        }
    }

    /// The product of the steps of a transform; the first is applied first.
    fn transform(&mut self, file: &File<'_>, node: Node<'_, '_>) -> Result<DMat4, SceneError> {
        let mut transform = DMat4::IDENTITY;
        for child in node.children().filter(Node::is_element) {
            let location = file.location(child);
            let attributes = self.attributes(&Element { node: child, location: &location })?;
            transform = step(&attributes, self.sources)? * transform;
            let size = transform.to_cols_array().iter().fold(0.0, |sum, value| sum + value.abs());
            if size.is_nan() || size > FARTHEST {
                return Err(location.refuse(format!("the transform is not finite, or beyond {FARTHEST:e}; correct it")));
            }
        }
        Ok(transform)
    }
}

/// An element and where it stands.
struct Element<'a, 'i> {
    node: Node<'a, 'i>,
    location: &'a Location,
}

struct Attributes {
    tag: String,
    location: Location,
    pairs: Vec<(String, String)>,
}

impl Attributes {
    fn get(&self, name: &str) -> Option<&str> {
        self.pairs.iter().find(|(known, _)| known == name).map(|(_, value)| &**value)
    }

    fn require(&self, name: &str) -> Result<&str, SceneError> {
        self.get(name).ok_or_else(|| self.location.refuse(format!("<{}> has no {name}; add it", self.tag)))
    }

    /// Notes attributes that mean nothing here.
    fn note_others(&self, known: &[&str], sources: &mut Sources) -> Result<(), SceneError> {
        for (name, _) in self.pairs.iter().filter(|(name, _)| !known.contains(&&**name)) {
            let text = format!("attribute `{}` has no effect on <{}>", excerpt(name), self.tag);
            sources.note(&Warning { kind: "attribute", location: self.location.clone(), text });
        }
        Ok(())
    }

    /// Numbers apart by white space or commas.
    fn numbers(&self, text: &str) -> Result<Vec<f64>, SceneError> {
        words(text).map(finite).collect::<Result<_, _>>().map_err(|problem| self.location.refuse(problem))
    }

    /// Three numbers: of `value`, which may also be one for all, or x, y and z, of which those that are missing are
    /// `default`.
    fn vector(&self, default: Option<f64>) -> Result<DVec3, SceneError> {
        let axes = ["x", "y", "z"];
        if let Some(text) = self.get("value") {
            if axes.iter().any(|axis| self.get(axis).is_some()) {
                return Err(self.location.refuse("value stands beside x, y or z; keep one of the two"));
            }
            return match self.numbers(text)?[..] {
                [one] => Ok(DVec3::splat(one)),
                [x, y, z] => Ok(DVec3::new(x, y, z)),
                _ => Err(self.location.refuse(format!("<{}> needs one number, or three; correct it", self.tag))),
            };
        }
        let mut vector = DVec3::ZERO;
        for (slot, axis) in axes.into_iter().enumerate() {
            vector[slot] = match (self.get(axis), default) {
                (Some(text), _) => finite(text.trim()).map_err(|problem| self.location.refuse(problem))?,
                (None, Some(default)) => default,
                (None, None) => return Err(self.location.refuse(format!("<{}> has no {axis}; add it", self.tag))),
            };
        }
        Ok(vector)
    }

    /// Three numbers in an attribute.
    fn point(&self, name: &str) -> Result<DVec3, SceneError> {
        match self.numbers(self.require(name)?)?[..] {
            [x, y, z] => Ok(DVec3::new(x, y, z)),
            _ => Err(self.location.refuse(format!("{name} needs three numbers; correct it"))),
        }
    }
}

/// One step of a transform.
fn step(attributes: &Attributes, sources: &mut Sources) -> Result<DMat4, SceneError> {
    let location = &attributes.location;
    match &*attributes.tag {
        "translate" => {
            attributes.note_others(&["value", "x", "y", "z"], sources)?;
            Ok(DMat4::from_translation(attributes.vector(Some(0.0))?))
        }
        "scale" => {
            attributes.note_others(&["value", "x", "y", "z"], sources)?;
            Ok(DMat4::from_scale(attributes.vector(Some(1.0))?))
        }
        "rotate" => {
            attributes.note_others(&["value", "x", "y", "z", "angle"], sources)?;
            let angle = attributes.require("angle")?;
            let angle = finite(angle.trim()).map_err(|problem| location.refuse(problem))?;
            match attributes.vector(Some(0.0))?.try_normalize() {
                Some(axis) => Ok(DMat4::from_axis_angle(axis, angle.to_radians())),
                None => Err(location.refuse("the axis of a rotation is zero; give it a direction")),
            }
        }
        "lookat" => {
            attributes.note_others(&["origin", "target", "up"], sources)?;
            let (origin, target) = (attributes.point("origin")?, attributes.point("target")?);
            let up = if attributes.get("up").is_some() { attributes.point("up")? } else { DVec3::ZERO };
            let Some(along) = (target - origin).try_normalize() else {
                return Err(location.refuse("target equals origin; move one of them"));
            };
            let left = up.cross(along).try_normalize().unwrap_or_else(|| along.any_orthonormal_vector());
            let matrix = DMat3::from_cols(left, along.cross(left), along);
            Ok(DAffine3 { matrix3: matrix, translation: origin }.into())
        }
        "matrix" => {
            attributes.note_others(&["value"], sources)?;
            let numbers = attributes.numbers(attributes.require("value")?)?;
            match numbers.len() {
                16 => {
                    let mut rows = [0.0; 16];
                    rows.copy_from_slice(&numbers);
                    Ok(DMat4::from_cols_array(&rows).transpose())
                }
                9 => {
                    let mut rows = [0.0; 9];
                    rows.copy_from_slice(&numbers);
                    Ok(DMat4::from_mat3(DMat3::from_cols_array(&rows).transpose()))
                }
                count => Err(location.refuse(format!("a matrix of {count} numbers; give 9 or 16"))),
            }
        }
        tag => {
            Err(location.refuse(format!("no step <{}> of a transform is known; correct or remove it", excerpt(tag))))
        }
    }
}

/// The value of a property that has its text in one attribute.
fn plain_value(tag: &str, text: &str) -> Result<Value, String> {
    let word = text.trim();
    match tag {
        "float" => finite(word).map(Value::Float),
        "integer" => {
            let value = word.parse().map_err(|_| format!("`{}` is not a whole number; correct it", excerpt(word)))?;
            Ok(Value::Integer(value))
        }
        "boolean" if word.eq_ignore_ascii_case("true") => Ok(Value::Boolean(true)),
        "boolean" if word.eq_ignore_ascii_case("false") => Ok(Value::Boolean(false)),
        "boolean" => Err(format!("`{}` is neither true nor false; write one of them", excerpt(word))),
        "rgb" => {
            let numbers: Vec<f64> = words(text).map(finite).collect::<Result<_, _>>()?;
            match numbers[..] {
                [grey] => Ok(Value::Rgb(DVec3::splat(grey))),
                [r, g, b] => Ok(Value::Rgb(DVec3::new(r, g, b))),
                _ => Err(format!("<rgb> of {} numbers; give one, or three", numbers.len())),
            }
        }
        _ => Ok(Value::Text(text.to_owned())),
    }
}

/// Words apart by white space or commas.
pub(super) fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| c == ',' || c.is_whitespace()).filter(|word| !word.is_empty())
}

/// A number that is finite.
pub(super) fn finite(word: &str) -> Result<f64, String> {
    let value = number(word).map_err(|problem| format!("{problem}; correct it"))?;
    if value.is_finite() { Ok(value) } else { Err(format!("`{}` is not finite; correct it", excerpt(word))) }
}

/// A text with its `$names` replaced. A backslash before a dollar keeps it.
fn substituted(text: &str, parameters: &Parameters) -> Result<String, String> {
    let mut result = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find('$') {
        let (before, after) = (&rest[..at], &rest[at + 1..]);
        if let Some(before) = before.strip_suffix('\\') {
            result += before;
            result.push('$');
            rest = after;
            continue;
        }
        result += before;
        let Some((name, value)) = parameters.iter().find(|(name, _)| after.starts_with(&**name)) else {
            let end = after.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(after.len());
            return Err(format!("nothing gives ${}; add a <default> for it", excerpt(&after[..end])));
        };
        result += value;
        rest = &after[name.len()..];
    }
    Ok(result + rest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{LoadOptions, sources::Files};

    const OUTER: &[u8] = b"<scene version='3.0.0'>\n<path value='parts'/>\n<default name='a' value='1'/>\n\
        <default name='ab' value='2'/>\n<include filename='inner.xml'/>\n<bsdf type='x' id='one'>\n\
        <float name='n' value='$ab'/><string name='s' value='\\$a $a'/>\n<ref id='late'/></bsdf>\n\
        <bsdf type='y' id='late'/><alias id='one' as='other'/><ref id='other'/></scene>";
    const INNER: &[u8] = b"<scene version='2.0.0'><default name='a' value='9'/><integrator type='$c'/></scene>";
    const FILES: &[(&str, &[u8])] = &[("s/o.xml", OUTER), ("s/parts/inner.xml", INNER)];

    #[test]
    fn names_are_substituted_and_files_found_on_the_path() {
        let (path, options) = (Path::new("s/o.xml"), LoadOptions::default());
        let mut sources = Sources::new(Files::Embedded(FILES), path, &options);
        let error = read(path, Vec::new(), &mut sources).expect_err("$c has no value").to_string();
        assert!(error.starts_with("s/parts/inner.xml:1: nothing gives $c;"), "{error}");
        let document = read(path, vec![("c".into(), "path".into())], &mut sources).expect("now it has");
        let names: Vec<_> =
            document.children(&document.objects[0]).map(|place| &*document.objects[place].plugin).collect();
        assert_eq!(names, ["path", "x", "y", "x"]);
        let one = &document.objects[2];
        assert_eq!((one.float("n", 0.0).expect("a float"), one.text("s").expect("a text")), (2.0, Some("$a 1")));
        assert_eq!(one.location.line, Some(6));
    }
}
