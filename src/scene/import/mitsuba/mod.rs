//! Scenes of Mitsuba 3, in its XML.
//!
//! An image is to be that of Mitsuba's RGB variants, up to noise and up to what `docs/scene-format.md` tells. A plugin that
//! is not known here stops the scene, with all others of the kind in one message, or is left out if so asked.

mod bsdfs;
mod emitters;
mod sensors;
mod serialized;
mod shapes;
mod spectra;
mod textures;
mod xml;

use std::{collections::HashMap, path::Path};

use glam::DAffine3;

use self::{
    bsdfs::Around,
    xml::{Document, Object},
};
use super::{Import, Instance};
use crate::scene::{
    error::{Location, SceneError},
    sources::{Sources, Warning},
    text::excerpt,
    transform::Transform,
};

/// Imports a scene with the files that it names.
pub(super) fn import(path: &Path, sources: &mut Sources) -> Result<Import, SceneError> {
    let document = xml::read(path, Vec::new(), sources)?;
    let mut importer = Importer {
        document: &document,
        sources,
        import: Import::default(),
        unsupported: Vec::new(),
        bsdfs: HashMap::new(),
        emitting: HashMap::new(),
        black: None,
        grey: None,
        nothing: None,
        meshes: HashMap::new(),
        geometries: HashMap::new(),
        groups: HashMap::new(),
    };
    importer.scene()?;
    let Importer { import, unsupported, sources, .. } = importer;
    match &unsupported[..] {
        [] => {}
        list if sources.options.lenient => {
            for (location, what) in list {
                let text = format!("{what} is not supported and left out");
                sources.note(&Warning { kind: "unsupported plugin", location: location.clone(), text });
            }
        }
        [(location, _), ..] => return Err(location.refuse(refusal(&unsupported, path))),
    }
    document.note_unused(sources);
    Ok(import)
}

/// What to say of plugins that are not supported, with their lines.
fn refusal(unsupported: &[(Location, String)], scene: &Path) -> String {
    let mut kinds: Vec<(&str, Vec<String>)> = Vec::new();
    for (location, what) in unsupported {
        let line = location.line.map_or_else(String::new, |line| line.to_string());
        let place = if location.path == scene { format!("line {line}") } else { location.to_string() };
        match kinds.iter_mut().find(|(known, _)| known == what) {
            Some((_, places)) => places.push(place),
            None => kinds.push((what, vec![place])),
        }
    }
    let kinds: Vec<String> = kinds
        .into_iter()
        .map(|(what, places)| {
            let more = places.len().saturating_sub(3);
            let more = if more > 0 { format!(" and {more} more") } else { String::new() };
            format!("{what} ({}{more})", places[..places.len().min(3)].join(", "))
        })
        .collect();
    format!("not supported: {}; take them out, or leave them out by --lenient", kinds.join("; "))
}

/// A scene in the making.
struct Importer<'d, 's, 'f> {
    document: &'d Document,
    sources: &'s mut Sources<'f>,
    import: Import,
    /// Plugins that are not supported, and where they are used.
    unsupported: Vec<(Location, String)>,
    /// Materials of BSDFs by place and by what is around them.
    bsdfs: HashMap<(usize, Around), u32>,
    /// Materials that also emit, by what they were before and by the emitter's place.
    emitting: HashMap<(u32, usize), u32>,
    black: Option<u32>,
    grey: Option<u32>,
    nothing: Option<u32>,
    /// Meshes by what they are made of.
    meshes: HashMap<MeshKey, usize>,
    /// Of each geometry a mesh that has it, and whether that is turned inside out.
    geometries: HashMap<shapes::Source, (usize, bool)>,
    /// What groups hold, by place.
    groups: HashMap<usize, Vec<Placed>>,
}

/// What makes a mesh: its shape, whether it is turned inside out, and its material.
type MeshKey = (shapes::Source, bool, u32);

/// A mesh, and where it is.
#[derive(Debug, Clone, Copy)]
struct Placed {
    mesh: usize,
    to_world: DAffine3,
}

impl Importer<'_, '_, '_> {
    fn note(&mut self, kind: &'static str, location: &Location, text: impl Into<String>) {
        self.sources.note(&Warning { kind, location: location.clone(), text: text.into() });
    }

    /// Notes a plugin that is not supported.
    fn unsupported(&mut self, object: &Object) {
        let all = object.location.clone();
        let what = format!("{} `{}`", object.tag, excerpt(&object.plugin));
        if !self.unsupported.iter().any(|(location, known)| *location == all && *known == what) {
            self.unsupported.push((all, what));
        }
    }

    fn scene(&mut self) -> Result<(), SceneError> {
        let document = self.document;
        let root = &document.objects[0];
        let mut sensors = 0;
        for place in document.children(root) {
            let object = &document.objects[place];
            match object.tag {
                "shape" => {
                    for Placed { mesh, to_world } in self.shape(place, false)? {
                        let is_mirrored = to_world.matrix3.determinant() < 0.0;
                        let transform = Transform::affine(to_world);
                        self.import.instances.push(Instance { mesh, transform, is_mirrored });
                    }
                }
                "emitter" => self.emitter(place)?,
                "integrator" => self.integrator(place, 0)?,
                "sensor" if sensors == 0 => {
                    self.sensor(place)?;
                    sensors += 1;
                }
                "sensor" => self.note("sensors", &object.location, "of several sensors the first is taken"),
                // Others count where something refers to them.
                _ => {}
            }
        }
        Ok(())
    }
}
