//! Builds small scenes as the texts of their files, so that closed forms hold the importers to the
//! physics too.

use std::fmt::Write;
use std::path::Path;

use glam::{DVec3, dvec3};
use raywave::scene::Scene;

use crate::common::scene_from;

/// A pinhole or a lens.
#[derive(Clone, Copy)]
pub struct View {
    pub eye: DVec3,
    pub target: DVec3,
    /// Degrees.
    pub vfov: f64,
    /// Lens radius.
    pub aperture: f64,
    /// Distance of the plane in focus.
    pub focus: f64,
}

impl View {
    pub fn new(eye: DVec3, target: DVec3, vfov: f64) -> Self {
        Self { eye, target, vfov, aperture: 0.0, focus: 1.0 }
    }

    /// +y, or +z where the view is along y.
    fn up(&self) -> DVec3 {
        let along_y = (self.target - self.eye).normalize().y.abs() > 0.999;
        if along_y { DVec3::Z } else { DVec3::Y }
    }

    /// The unit direction through a point of a square image, (0, 0) its top left corner and
    /// (1, 1) its bottom right one.
    pub fn direction(&self, x: f64, y: f64) -> DVec3 {
        let forward = (self.target - self.eye).normalize();
        let right = forward.cross(self.up()).normalize();
        let up = right.cross(forward);
        let half = (0.5 * self.vfov.to_radians()).tan();
        (forward + half * ((2.0 * x - 1.0) * right + (1.0 - 2.0 * y) * up)).normalize()
    }
}

/// A scene in the making: fronts are where corners run counter-clockwise.
pub struct Stage {
    pub view: View,
    obj: String,
    mtl: String,
    environment: String,
}

impl Stage {
    pub fn new(view: View) -> Self {
        let obj = "mtllib scene.mtl\n".to_owned();
        Self { view, obj, mtl: String::new(), environment: String::new() }
    }

    /// Light of one radiance from everywhere.
    pub fn sky(mut self, radiance: f64) -> Self {
        self.environment = format!("[environment]\nradiance = [{radiance}, {radiance}, {radiance}]\n");
        self
    }

    /// Light of a lat-long image.
    pub fn sky_image(mut self, file: &Path) -> Self {
        self.environment = format!("[environment]\nfile = {:?}\n", file.display().to_string());
        self
    }

    /// A material that what follows is made of; `keys` as in MTL, with `;` between lines.
    pub fn material(mut self, keys: &str) -> Self {
        let name = format!("m{}", self.mtl.matches("newmtl").count());
        writeln!(self.mtl, "newmtl {name}\n{}", keys.replace(';', "\n")).expect("strings grow");
        writeln!(self.obj, "usemtl {name}").expect("strings grow");
        self
    }

    /// A convex polygon.
    pub fn polygon(mut self, corners: &[DVec3]) -> Self {
        self.corners("v", corners);
        let face: Vec<String> = (1..=corners.len()).rev().map(|i| format!("-{i}")).collect();
        writeln!(self.obj, "f {}", face.join(" ")).expect("strings grow");
        self
    }

    /// A convex polygon with a shading normal at each corner.
    pub fn shaded_polygon(mut self, corners: &[DVec3], normals: &[DVec3]) -> Self {
        self.corners("v", corners);
        self.corners("vn", normals);
        let face: Vec<String> = (1..=corners.len()).rev().map(|i| format!("-{i}//-{i}")).collect();
        writeln!(self.obj, "f {}", face.join(" ")).expect("strings grow");
        self
    }

    fn corners(&mut self, key: &str, points: &[DVec3]) {
        for p in points {
            writeln!(self.obj, "{key} {} {} {}", p.x, p.y, p.z).expect("strings grow");
        }
    }

    pub fn polygons<'a>(self, polygons: impl IntoIterator<Item = &'a Vec<DVec3>>) -> Self {
        polygons.into_iter().fold(self, |stage, polygon| stage.polygon(polygon))
    }

    /// A square of half side `half` about `centre`, its front towards `normal`.
    pub fn square(self, centre: DVec3, normal: DVec3, half: f64) -> Self {
        let a = half * normal.any_orthonormal_vector();
        let b = normal.cross(a);
        self.polygon(&[centre - a - b, centre + a - b, centre + a + b, centre - a + b])
    }

    /// A box about the origin, its fronts outwards.
    pub fn cube(self, half: f64) -> Self {
        let sides = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|axis| [axis, -axis]);
        sides.fold(self, |stage, side| stage.square(half * side, side, half))
    }

    pub fn scene(&self) -> Scene {
        let View { eye, target, vfov, aperture, focus } = self.view;
        let toml = format!(
            "[camera]\neye = {}\ntarget = {}\nup = {}\nvfov = {vfov}\naperture = {aperture}\nfocus = {focus}\n\
             [[mesh]]\nfile = \"scene.obj\"\n{}",
            array(eye),
            array(target),
            array(self.view.up()),
            self.environment
        );
        scene_from(&toml, &self.obj, &self.mtl)
    }
}

fn array(v: DVec3) -> String {
    format!("[{:?}, {:?}, {:?}]", v.x, v.y, v.z)
}

/// A sphere about the origin of `rows` bands, twice as many around; flat, its fronts outwards.
pub fn sphere(radius: f64, rows: u32) -> Vec<Vec<DVec3>> {
    let point = |row: u32, column: u32| {
        let (sin_row, cos_row) = (std::f64::consts::PI * f64::from(row) / f64::from(rows)).sin_cos();
        let (sin, cos) = (std::f64::consts::PI * f64::from(column) / f64::from(rows)).sin_cos();
        radius * dvec3(sin_row * sin, cos_row, sin_row * cos)
    };
    let bands = (0..rows).flat_map(|row| (0..2 * rows).map(move |column| (row, column)));
    bands
        .map(|(row, column)| {
            let next = (column + 1) % (2 * rows);
            match row {
                0 => vec![point(0, 0), point(1, column), point(1, next)],
                _ if row + 1 == rows => vec![point(row, column), point(rows, 0), point(row, next)],
                _ => vec![point(row, column), point(row + 1, column), point(row + 1, next), point(row, next)],
            }
        })
        .collect()
}

/// The same faces seen from their backs.
pub fn inside_out(mut polygons: Vec<Vec<DVec3>>) -> Vec<Vec<DVec3>> {
    polygons.iter_mut().for_each(|corners| corners.reverse());
    polygons
}

/// Area of plane convex polygons.
pub fn area(polygons: &[Vec<DVec3>]) -> f64 {
    let fan = |p: &Vec<DVec3>| p.windows(2).map(|e| (e[0] - p[0]).cross(e[1] - p[0])).sum::<DVec3>().length();
    polygons.iter().map(|polygon| 0.5 * fan(polygon)).sum()
}
