//! The gallery: a scene of our own, made rather than drawn, for any number of triangles.
//!
//! A hall with a colonnade open to an evening sky, statues of most kinds of surface on plinths, and
//! lamps of several sizes and colours. The same count gives the same files. Meshes are streamed:
//! memory does not grow with the count.

use std::{
    f64::consts::{PI, TAU},
    fs,
    io::{self, Cursor, Write},
    path::Path,
};

use glam::{DQuat, DVec2, DVec3, dvec2, dvec3};

use super::{Location, SceneError};
use crate::whole_file;

const SCENE: &str = "\
# The gallery: a hall of statues and lamps, open to an evening sky on its left.
[camera]
eye = [1.2, 2.35, 4.6]
target = [-0.15, 1.05, -3.6]
vfov = 46.0

[film]
width = 960
height = 540

[render]
integrator = \"explicit\"
samples = 64
max_bounces = 8

[[mesh]]
file = \"gallery.obj\"

[environment]
file = \"gallery.exr\"
";

const MATERIALS: &str = "\
# Materials of the gallery. The building:
newmtl floor
  Kd 0.5 0.5 0.5
  map_Kd gallery.png
newmtl plaster
  Kd 0.74 0.69 0.60
newmtl ceiling
  Kd 0.78 0.76 0.72
newmtl panelling
  Kd 0.17 0.08 0.045
  Ks 0.10 0.10 0.10
  Ns 40
newmtl marble
  Kd 0.64 0.60 0.54
  Ks 0.18 0.18 0.18
  Ns 180
newmtl sandstone
  Kd 0.56 0.44 0.32
newmtl travertine
  Kd 0.55 0.45 0.33
newmtl basalt
  Kd 0.09 0.09 0.10
  Ks 0.12 0.12 0.12
  Ns 60
newmtl iron
  Kd 0.03 0.03 0.03
  Ks 0.20 0.20 0.20
  Ns 20
newmtl velvet
  Kd 0.34 0.03 0.06
newmtl canvas_blue
  Kd 0.06 0.14 0.38
newmtl canvas_ochre
  Kd 0.62 0.36 0.08
newmtl canvas_green
  Kd 0.10 0.30 0.16

# The statues:
newmtl gold
  illum 3
  Ks 0.95 0.74 0.36
newmtl silver
  illum 3
  Ks 0.92 0.92 0.92
newmtl brass
  Kd 0.20 0.13 0.03
  Ks 0.68 0.50 0.20
  Ns 70
newmtl copper
  Kd 0.12 0.05 0.03
  Ks 0.70 0.38 0.26
  Ns 22
newmtl glass
  illum 7
  Ni 1.5
newmtl bottle_glass
  illum 7
  Ni 1.52
  Tf 0.55 0.90 0.66
newmtl crystal
  illum 6
  Ni 1.4
newmtl amber
  illum 6
  Ni 1.25
  Tf 1.00 0.72 0.30
newmtl jade
  Kd 0.11 0.40 0.21
  Ks 0.22 0.22 0.22
  Ns 90
newmtl lacquer
  Kd 0.55 0.04 0.03
  Ks 0.30 0.30 0.30
  Ns 400
newmtl cobalt
  Kd 0.04 0.09 0.46
  Ks 0.22 0.22 0.22
  Ns 140
newmtl porcelain
  Kd 0.74 0.73 0.70
  Ks 0.20 0.20 0.20
  Ns 800
newmtl pearl
  Kd 0.46 0.41 0.39
  Ks 0.42 0.40 0.38
  Ns 12
newmtl sand
  Kd 0.64 0.55 0.40
newmtl rock
  Kd 0.20 0.19 0.18

# The lamps:
newmtl skylight
  Kd 0 0 0
  Ke 7.5 7.2 6.6
newmtl lamp_warm
  Kd 0 0 0
  Ke 34 21 9
newmtl lamp_cool
  Kd 0 0 0
  Ke 12 20 30
newmtl lamp_rose
  Kd 0 0 0
  Ke 30 9 15
newmtl tube
  Kd 0 0 0
  Ke 6 16 14
newmtl ember
  Kd 0 0 0
  Ke 60 20 4
";

/// Writes `gallery.toml` and the files it names into `dir`, which is made where it is missing.
/// Each file appears whole or not at all; the scene file comes last.
///
/// The mesh has about `triangles` triangles: within 2 % from 50 000 on, and never fewer
/// than the few thousand that its shapes need.
///
/// # Errors
/// Where a file cannot be written.
pub fn generate_gallery(dir: &Path, triangles: usize) -> Result<(), SceneError> {
    let refuse = |path: &Path, error: &io::Error| {
        Location::file(path).refuse(format!("cannot be written ({error}); check the folder and the space left"))
    };
    fs::create_dir_all(dir).map_err(|error| refuse(dir, &error))?;
    let write = |name: &str, fill: &dyn Fn(&mut dyn Write) -> io::Result<()>| {
        let path = dir.join(name);
        whole_file::write(&path, fill).map_err(|error| refuse(&path, &error))
    };
    write("gallery.mtl", &|out| out.write_all(MATERIALS.as_bytes()))?;
    write("gallery.png", &|out| out.write_all(&tiles()?))?;
    write("gallery.exr", &|out| evening_sky(out))?;
    write("gallery.obj", &|out| gallery(out, triangles))?;
    write("gallery.toml", &|out| out.write_all(SCENE.as_bytes()))
}

/// A square of two pale and two dark floor tiles with joints between them, as PNG.
fn tiles() -> io::Result<Vec<u8>> {
    const SIZE: u32 = 256;
    const TILE: u32 = SIZE / 2;
    const JOINT: u32 = 3;
    let pixel = |x: u32, y: u32| {
        let in_joint = x % TILE < JOINT || y % TILE < JOINT;
        let is_pale = (x / TILE + y / TILE).is_multiple_of(2);
        let at = dvec3(f64::from(x), f64::from(y), 0.0);
        let vein = fractal_noise(at * dvec3(0.02, 0.05, 1.0));
        let [r, g, b] = match (in_joint, is_pale) {
            (true, _) => [70.0, 66.0, 60.0],
            (_, true) => [206.0, 196.0, 178.0],
            (_, false) => [92.0, 72.0, 62.0],
        };
        let shade = |channel: f64| (channel * (1.0 + 0.22 * vein)).clamp(0.0, 255.0) as u8;
        image::Rgb([shade(r), shade(g), shade(b)])
    };
    let mut bytes = Cursor::new(Vec::new());
    image::RgbImage::from_fn(SIZE, SIZE, pixel)
        .write_to(&mut bytes, image::ImageFormat::Png)
        .map_err(io::Error::other)?;
    Ok(bytes.into_inner())
}

/// An evening sky as a lat-long EXR: blue above, a broad glow low on the left, dark ground below.
fn evening_sky(out: &mut dyn Write) -> io::Result<()> {
    use exr::prelude::*;

    const SIZE: (usize, usize) = (128, 64);
    let pixel = |at: Vec2<usize>| {
        let azimuth = (at.x() as f64 + 0.5) / SIZE.0 as f64 * TAU - PI;
        let (sine, cosine) = (PI * (at.y() as f64 + 0.5) / SIZE.1 as f64).sin_cos();
        let direction = dvec3(sine * azimuth.sin(), cosine, -sine * azimuth.cos());
        let glow = direction.dot(dvec3(-0.92, 0.16, -0.36).normalize()).max(0.0);
        let zenith = dvec3(0.16, 0.26, 0.55);
        let horizon = dvec3(0.95, 0.62, 0.42);
        let sky = horizon.lerp(zenith, direction.y.max(0.0).powf(0.45));
        let sky = 1.3 * sky + dvec3(9.0, 4.6, 1.7) * glow.powi(24);
        let ground = dvec3(0.10, 0.08, 0.07);
        // The horizon is soft, so that bilinear lookup and a step do not meet.
        let colour = ground.lerp(sky, (direction.y * 12.0 + 0.5).clamp(0.0, 1.0));
        (colour.x as f32, colour.y as f32, colour.z as f32)
    };
    let image = Image::from_channels(SIZE, SpecificChannels::rgb(pixel));
    let mut bytes = Cursor::new(Vec::new());
    // Threads would write the rows in the order they finish them.
    image.write().non_parallel().to_buffered(&mut bytes).map_err(io::Error::other)?;
    out.write_all(bytes.get_ref())
}

/// The whole mesh. Shapes share the triangles that the flat parts leave, by weight.
fn gallery(out: &mut dyn Write, triangles: usize) -> io::Result<()> {
    let boxes = boxes();
    let shapes = shapes();
    let budget = triangles.saturating_sub(2 + boxes.len() * 12);
    let weight: f64 = shapes.iter().map(|shape| shape.weight).sum();

    let mut mesh = ObjWriter::new(out);
    mesh.preamble()?;
    mesh.floor()?;
    for (material, low, high) in boxes {
        mesh.cuboid(material, low, high)?;
    }
    for shape in &shapes {
        mesh.shape(shape, budget as f64 * shape.weight / weight)?;
    }
    Ok(())
}

/// Bounds of the hall, metres. The floor is y = 0, the open side is -x, the visitor looks to -z.
const HALL: (DVec3, DVec3) = (dvec3(-5.2, 0.0, -13.0), dvec3(4.6, 5.0, 5.2));

/// Where the columns stand along z, from front to back.
const COLUMNS_Z: [f64; 6] = [2.6, -0.2, -3.0, -5.8, -8.6, -11.4];
const LEFT_COLUMNS_X: f64 = -3.3;
const RIGHT_COLUMNS_X: f64 = 3.1;

/// A sand garden in a basin.
const GARDEN: (DVec3, DVec3) = (dvec3(-1.7, 0.0, -7.6), dvec3(1.7, 0.42, -4.6));

/// Materials and opposite corners of everything with right angles.
fn boxes() -> Vec<(&'static str, DVec3, DVec3)> {
    let (low, high) = HALL;
    let mut boxes = vec![
        ("ceiling", dvec3(low.x, high.y, low.z), high + dvec3(0.2, 0.25, 0.0)),
        ("plaster", dvec3(low.x, 0.0, low.z - 0.2), dvec3(high.x, high.y, low.z)),
        ("plaster", dvec3(low.x, 0.0, high.z), dvec3(high.x, high.y, high.z + 0.2)),
        ("plaster", dvec3(high.x, 1.2, low.z), dvec3(high.x + 0.2, high.y, high.z)),
        ("panelling", dvec3(high.x - 0.05, 0.0, low.z), dvec3(high.x + 0.2, 1.2, high.z)),
        // A parapet and a lintel close the open side below and above.
        ("travertine", dvec3(low.x, 0.0, low.z), dvec3(low.x + 0.25, 0.85, high.z)),
        ("travertine", dvec3(low.x - 0.05, 0.85, low.z), dvec3(low.x + 0.3, 0.95, high.z)),
        ("plaster", dvec3(low.x, 4.3, low.z), dvec3(low.x + 0.25, 5.0, high.z)),
        // Pictures on the right and at the back, and a strip of light under the cornice.
        ("canvas_ochre", dvec3(high.x - 0.06, 1.7, -2.4), dvec3(high.x, 3.3, -0.8)),
        ("canvas_green", dvec3(high.x - 0.06, 1.7, -5.2), dvec3(high.x, 3.3, -3.6)),
        ("canvas_blue", dvec3(high.x - 0.06, 1.7, -8.0), dvec3(high.x, 3.3, -6.4)),
        ("canvas_blue", dvec3(-1.5, 1.3, low.z), dvec3(1.3, 3.7, low.z + 0.06)),
        ("tube", dvec3(high.x - 0.12, 3.9, -11.0), dvec3(high.x - 0.05, 3.96, 2.0)),
    ];
    for z in COLUMNS_Z {
        for x in [LEFT_COLUMNS_X, RIGHT_COLUMNS_X] {
            let axis = dvec3(x, 0.0, z);
            boxes.push(("basalt", axis - dvec3(0.5, 0.0, 0.5), axis + dvec3(0.5, 0.16, 0.5)));
            boxes.push(("travertine", axis + dvec3(-0.5, 4.72, -0.5), axis + dvec3(0.5, 5.0, 0.5)));
        }
    }
    for z in [1.0, -3.4, -7.8] {
        boxes.push(("skylight", dvec3(-1.1, 4.95, z - 0.55), dvec3(1.1, 5.0, z + 0.55)));
    }
    for (centre, half, height) in PLINTHS {
        let (x, z) = (centre.x, centre.y);
        let foot = half + 0.06;
        boxes.push(("basalt", dvec3(x - foot, 0.0, z - foot), dvec3(x + foot, 0.1, z + foot)));
        boxes.push(("travertine", dvec3(x - half, 0.1, z - half), dvec3(x + half, height, z + half)));
    }
    let (low, high) = GARDEN;
    let rim = 0.16;
    for (material, from, to) in [
        ("basalt", dvec3(low.x - rim, 0.0, low.z - rim), dvec3(low.x, high.y, high.z + rim)),
        ("basalt", dvec3(high.x, 0.0, low.z - rim), dvec3(high.x + rim, high.y, high.z + rim)),
        ("basalt", dvec3(low.x, 0.0, low.z - rim), dvec3(high.x, high.y, low.z)),
        ("basalt", dvec3(low.x, 0.0, high.z), dvec3(high.x, high.y, high.z + rim)),
    ] {
        boxes.push((material, from, to));
    }
    boxes
}

/// Centre (x, z), half width and height of each plinth.
const PLINTHS: [(DVec2, f64, f64); 10] = [
    (dvec2(1.45, -0.2), 0.34, 0.80),
    (dvec2(-1.35, 0.0), 0.36, 0.80),
    (dvec2(-0.95, -2.4), 0.32, 0.55),
    (dvec2(2.05, -3.0), 0.34, 0.90),
    (dvec2(-2.05, -3.0), 0.32, 1.05),
    (dvec2(2.25, -5.0), 0.30, 0.90),
    (dvec2(-2.35, -6.4), 0.34, 0.90),
    (dvec2(2.05, -8.6), 0.36, 0.85),
    (dvec2(-1.75, -9.6), 0.40, 0.75),
    (dvec2(0.35, -10.2), 0.55, 0.45),
];

/// A point on top of a plinth, `height` above it.
fn above(plinth: usize, height: f64) -> DVec3 {
    let (centre, _, top) = PLINTHS[plinth];
    dvec3(centre.x, top + height, centre.y)
}

/// How the edges of a shape's parameter square meet.
#[derive(Clone, Copy, PartialEq)]
enum Seam {
    /// A sheet with four free edges.
    Open,
    /// Closed in u, open at both ends of v.
    Tube,
    /// Closed in u, a single point at either end of v.
    Poles,
    /// Closed in u and in v.
    Torus,
}

/// A surface over the unit square; its front is the side of du x dv.
struct Shape {
    material: &'static str,
    seam: Seam,
    /// Has normals; without, its facets show.
    is_smooth: bool,
    /// Share of the triangles.
    weight: f64,
    /// Quads along u for each along v, so that they come out about square.
    aspect: f64,
    point: Box<dyn Fn(f64, f64) -> DVec3>,
}

impl Shape {
    fn new(
        material: &'static str,
        seam: Seam,
        weight: f64,
        aspect: f64,
        point: impl Fn(f64, f64) -> DVec3 + 'static,
    ) -> Self {
        Self { material, seam, is_smooth: true, weight, aspect, point: Box::new(point) }
    }

    fn ball(material: &'static str, weight: f64, centre: DVec3, radius: f64) -> Self {
        let point = move |u, v| centre + radius * on_sphere(u, v);
        Self::new(material, Seam::Poles, weight, 2.0, point)
    }

    /// A ball with dents and bulges; `frequency` is how many across its radius.
    fn blob(
        material: &'static str,
        weight: f64,
        (centre, radius): (DVec3, f64),
        (roughness, frequency): (f64, f64),
    ) -> Self {
        let point = move |u, v| {
            let direction = on_sphere(u, v);
            let bulge = 1.0 + roughness * fractal_noise(frequency * direction + centre);
            centre + radius * bulge * direction
        };
        Self::new(material, Seam::Poles, weight, 2.0, point)
    }

    /// A torus about the y axis.
    fn ring(material: &'static str, weight: f64, centre: DVec3, radius: f64, tube: f64) -> Self {
        let aspect = tube / radius;
        let point = move |u, v| centre + ring(radius, tube, v, u);
        Self::new(material, Seam::Torus, weight, aspect, point)
    }

    fn faceted(self) -> Self {
        Self { is_smooth: false, ..self }
    }
}

fn shapes() -> Vec<Shape> {
    use Seam::{Open, Poles, Torus, Tube};

    let ball = Shape::ball;
    let blob = Shape::blob;
    let vase_on = |plinth, height| move |u, v| vase(above(plinth, 0.0), height, u, v);
    let mut shapes = vec![
        ball("glass", 3.0, above(0, 0.36), 0.36),
        Shape::new("gold", Torus, 9.0, 0.1, |u, v| knot(above(1, 0.60), 0.38, v, u)),
        blob("jade", 6.0, (above(2, 0.34), 0.36), (0.45, 1.5)),
        Shape::new("lacquer", Poles, 5.0, 1.0, |u, v| twist(above(3, 0.0), u, v)),
        Shape::new("porcelain", Tube, 5.0, 1.2, vase_on(4, 0.95)),
        ball("crystal", 3.0, above(5, 0.30), 0.30),
        blob("copper", 6.0, (above(6, 0.38), 0.38), (0.4, 1.5)),
        Shape::new("cobalt", Tube, 4.0, 1.2, vase_on(7, 1.15)),
        Shape::new("brass", Torus, 5.0, 0.15, |u, v| hoop(above(8, 0.52), v, u)),
        ball("amber", 2.0, above(8, 0.52), 0.24),
        ball("silver", 4.0, above(9, 0.85), 0.85),
        ball("pearl", 2.0, dvec3(0.45, 0.26, 0.35), 0.26),
        ball("bottle_glass", 2.0, dvec3(-0.15, 0.19, 0.75), 0.19),
        ball("silver", 1.5, dvec3(0.55, 0.58, -5.5), 0.34),
        Shape::new("sand", Open, 22.0, 1.0, sand),
        Shape::new("velvet", Open, 5.0, 4.0, curtain),
    ];
    for (centre, radius) in ROCKS {
        let point = move |u, v| rock(centre, radius, u, v);
        shapes.push(Shape::new("rock", Poles, 1.2, 2.0, point).faceted());
    }
    for (index, z) in COLUMNS_Z.into_iter().enumerate() {
        // Columns far from the camera take fewer triangles.
        let weight = 5.0 / (1.0 + 0.4 * index as f64);
        for (x, material) in [(LEFT_COLUMNS_X, "marble"), (RIGHT_COLUMNS_X, "sandstone")] {
            let point = move |u, v| column(dvec3(x, 0.16, z), u, v);
            shapes.push(Shape::new(material, Tube, weight, 2.0, point));
        }
    }
    for (material, centre, radius) in [
        ("lamp_warm", dvec3(-1.05, 3.35, -1.6), 0.17),
        ("lamp_cool", dvec3(1.15, 3.65, -4.2), 0.15),
        ("lamp_rose", dvec3(-1.35, 3.45, -7.2), 0.16),
        ("lamp_warm", dvec3(1.1, 3.3, -9.3), 0.18),
    ] {
        let rod = move |u, v| {
            let top = HALL.1.y;
            let hook = centre + dvec3(0.0, radius, 0.0);
            revolved(hook, 0.012, (top - hook.y) * v, u)
        };
        shapes.push(ball(material, 0.4, centre, radius));
        shapes.push(Shape::new("iron", Tube, 0.1, 0.2, rod));
    }
    for z in [1.2, -1.6, -4.4, -7.2, -10.0] {
        let centre = dvec3(-5.05, 1.02, z);
        shapes.push(ball("ember", 0.2, centre, 0.06));
        shapes.push(Shape::ring("iron", 0.4, centre, 0.11, 0.03));
    }
    shapes
}

/// The sand of the garden, facing up.
fn sand(u: f64, v: f64) -> DVec3 {
    let (low, high) = GARDEN;
    let at = dvec2(low.x + (high.x - low.x) * v, low.z + (high.z - low.z) * u);
    dvec3(at.x, 0.26 + sand_height(at), at.y)
}

/// A rock that rests in the sand, flat underneath.
fn rock(centre: DVec2, radius: f64, u: f64, v: f64) -> DVec3 {
    let direction = on_sphere(u, v);
    let bulge = 1.0 + 0.42 * fractal_noise(1.7 * direction + 9.0 * centre.extend(radius));
    let squash = dvec3(1.0, if direction.y < 0.0 { 0.2 } else { 0.85 }, 1.0);
    dvec3(centre.x, 0.27, centre.y) + radius * bulge * direction * squash
}

/// A curtain before the back wall, in folds that deepen towards the floor.
fn curtain(u: f64, v: f64) -> DVec3 {
    let fold = 0.15 * (TAU * 7.0 * u + 1.5 * (5.0 * u).sin()).sin() * (1.0 - 0.55 * v);
    let sway = 0.08 * fractal_noise(dvec3(6.0 * u, 2.0 * v, 0.5));
    dvec3(1.75 + 2.6 * u, 0.02 + 4.18 * v, -12.55 + fold + sway)
}

/// Centre (x, z) and radius of the rocks in the garden.
const ROCKS: [(DVec2, f64); 5] = [
    (dvec2(-0.95, -5.35), 0.42),
    (dvec2(-0.35, -5.05), 0.20),
    (dvec2(0.15, -6.75), 0.50),
    (dvec2(-1.15, -6.95), 0.26),
    (dvec2(1.25, -6.55), 0.22),
];

/// Raked sand: straight waves along the basin that give way to rings around each rock.
fn sand_height(at: DVec2) -> f64 {
    const WAVELENGTH: f64 = 0.2;
    const REACH: f64 = 0.5;
    let wave = |distance: f64| (TAU * distance / WAVELENGTH).sin();
    let mut straight = 1.0;
    let mut height = 0.0;
    for (centre, radius) in ROCKS {
        let distance = centre.distance(at) - radius;
        let near = 1.0 - (distance / REACH).clamp(0.0, 1.0);
        let share = straight * near * near * (3.0 - 2.0 * near);
        straight -= share;
        height += share * wave(distance);
    }
    let grain = fractal_noise(dvec3(5.0 * at.x, 0.0, 5.0 * at.y));
    0.024 * (height + straight * wave(at.x)) + 0.005 * grain
}

/// The unit sphere, u about the y axis, v from the lower pole to the upper.
fn on_sphere(u: f64, v: f64) -> DVec3 {
    let (sin_azimuth, cos_azimuth) = (TAU * u).sin_cos();
    let (sin_polar, cos_polar) = (PI * v).sin_cos();
    dvec3(sin_polar * sin_azimuth, -cos_polar, sin_polar * cos_azimuth)
}

/// A point of a body of revolution about the y axis.
fn revolved(foot: DVec3, radius: f64, height: f64, u: f64) -> DVec3 {
    let (sine, cosine) = (TAU * u).sin_cos();
    foot + dvec3(radius * sine, height, radius * cosine)
}

/// A fluted column with swelling ends, 4.56 high.
fn column(foot: DVec3, u: f64, v: f64) -> DVec3 {
    let t = 0.5 - 0.5 * (PI * v).cos(); // Rows crowd at the ends, where the profile bends.
    let bell = |at: f64, width: f64| (-((t - at) / width).powi(2)).exp();
    let shaft = ((t - 0.05) * 30.0).clamp(0.0, 1.0) * ((0.94 - t) * 30.0).clamp(0.0, 1.0);
    let flute = 0.026 * shaft * (0.5 - 0.5 * (TAU * 16.0 * u).cos());
    let ends = 0.14 * bell(0.0, 0.03) + 0.18 * bell(1.0, 0.05);
    revolved(foot, 0.29 - 0.045 * t - flute + ends, 4.56 * t, u)
}

/// A vase with a slight fluting, `height` high.
fn vase(foot: DVec3, height: f64, u: f64, v: f64) -> DVec3 {
    let belly = 0.20 * (PI * v.powf(0.8)).sin().max(0.0).powf(1.3);
    let lip = 0.09 * (-((1.0 - v) / 0.07).powi(2)).exp();
    let foot_flare = 0.06 * (-(v / 0.05).powi(2)).exp();
    let flute = 1.0 + 0.03 * (TAU * 12.0 * (u + 0.35 * v)).cos() * (PI * v).sin();
    revolved(foot, height * flute * (0.09 + belly + lip + foot_flare), height * v, u)
}

/// A rounded square bar that twists as it rises, closed at both ends.
fn twist(foot: DVec3, u: f64, v: f64) -> DVec3 {
    let (sine, cosine) = (TAU * u).sin_cos();
    let rounded = |x: f64| x.signum() * x.abs().powf(0.45);
    // The profile rises within the first and last tenth of v, so that the ends are caps.
    let cap = |v: f64| (1.0 - (1.0 - (10.0 * v).min(1.0)).powi(2)).max(0.0).sqrt();
    let radius = 0.23 * cap(v) * cap(1.0 - v) * (1.0 - 0.25 * (PI * v).sin());
    let turn = DVec2::from_angle(1.2 * PI * v);
    let section = turn.rotate(dvec2(rounded(sine), rounded(cosine))) * radius;
    foot + dvec3(section.x, 1.15 * v, section.y)
}

/// A torus about the y axis at the origin; `u` runs along it, `v` around its tube, downwards first.
fn ring(radius: f64, tube: f64, u: f64, v: f64) -> DVec3 {
    let (sine, cosine) = (-TAU * v).sin_cos();
    revolved(DVec3::ZERO, radius + tube * cosine, tube * sine, u)
}

/// A bent ring that stands on its edge.
fn hoop(centre: DVec3, u: f64, v: f64) -> DVec3 {
    let radius = 0.42 * (1.0 + 0.10 * (3.0 * TAU * u).cos());
    let bend = dvec3(0.0, 0.12 * (2.0 * TAU * u).sin(), 0.0);
    centre + DQuat::from_rotation_x(1.05) * (ring(radius, 0.055, u, v) + bend)
}

/// A (2, 3) torus knot; `u` runs along it, `v` around its tube.
fn knot(centre: DVec3, size: f64, u: f64, v: f64) -> DVec3 {
    let curve = |u: f64| {
        let (sin_two, cos_two) = (2.0 * TAU * u).sin_cos();
        let (sin_three, cos_three) = (3.0 * TAU * u).sin_cos();
        let radius = 1.0 + 0.45 * cos_three;
        dvec3(radius * cos_two, radius * sin_two, 0.55 * sin_three)
    };
    const STEP: f64 = 1e-4;
    let (before, after) = (curve(u - STEP), curve(u + STEP));
    let tangent = (after - before).normalize();
    let side = tangent.cross(before + after).normalize();
    let (sine, cosine) = (TAU * v).sin_cos();
    let tube = 0.24 * (cosine * side.cross(tangent) + sine * side);
    centre + size * (curve(u) + tube)
}

/// Four octaves of value noise, about -1 to 1.
fn fractal_noise(at: DVec3) -> f64 {
    let octave = |k: i32| 0.5f64.powi(k) * value_noise(at * 2.0f64.powi(k) + f64::from(k) * 17.3);
    0.55 * (0..4).map(octave).sum::<f64>()
}

/// Smoothly interpolated lattice noise, -1 to 1.
fn value_noise(at: DVec3) -> f64 {
    let cell = at.floor();
    let t = at - cell;
    let t = t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let corner = |dx: f64, dy: f64, dz: f64| lattice(cell + dvec3(dx, dy, dz));
    let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
    let plane = |dz: f64| {
        mix(
            mix(corner(0.0, 0.0, dz), corner(1.0, 0.0, dz), t.x),
            mix(corner(0.0, 1.0, dz), corner(1.0, 1.0, dz), t.x),
            t.y,
        )
    };
    mix(plane(0.0), plane(1.0), t.z)
}

/// A hash of an integer point to -1..1.
fn lattice(cell: DVec3) -> f64 {
    let [x, y, z] = cell.as_i64vec3().to_array().map(|i| i as u64);
    let mut h = x
        .wrapping_mul(0x9e37_79b9_7f4a_7c15)
        .wrapping_add(y.wrapping_mul(0xc2b2_ae3d_27d4_eb4f))
        .wrapping_add(z.wrapping_mul(0x1656_67b1_9e37_79f9));
    h = (h ^ (h >> 31)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h ^= h >> 29;
    (h >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// Streams OBJ text and knows the next free indices.
struct ObjWriter<W> {
    out: W,
    material: &'static str,
    positions: usize,
    normals: usize,
}

impl<W: Write> ObjWriter<W> {
    fn new(out: W) -> Self {
        Self { out, material: "", positions: 0, normals: 0 }
    }

    fn preamble(&mut self) -> io::Result<()> {
        writeln!(self.out, "# The gallery, generated.\nmtllib gallery.mtl")
    }

    fn use_material(&mut self, material: &'static str) -> io::Result<()> {
        if self.material != material {
            self.material = material;
            writeln!(self.out, "usemtl {material}")?;
        }
        Ok(())
    }

    fn position(&mut self, point: DVec3) -> io::Result<()> {
        self.positions += 1;
        writeln!(self.out, "v {:.6} {:.6} {:.6}", point.x, point.y, point.z)
    }

    /// The floor, its texture repeated every two metres.
    fn floor(&mut self) -> io::Result<()> {
        let (low, high) = HALL;
        self.use_material("floor")?;
        for (x, z) in [(low.x, high.z), (high.x, high.z), (high.x, low.z), (low.x, low.z)] {
            writeln!(self.out, "vt {:.4} {:.4}", 0.5 * x, -0.5 * z)?;
            self.position(dvec3(x, 0.0, z))?;
        }
        writeln!(self.out, "f 1/1 2/2 3/3 4/4")
    }

    /// Six quads that face outwards.
    fn cuboid(&mut self, material: &'static str, low: DVec3, high: DVec3) -> io::Result<()> {
        self.use_material(material)?;
        let base = self.positions + 1;
        for corner in 0..8 {
            let pick = |bit: usize, low: f64, high: f64| match corner >> bit & 1 {
                0 => low,
                _ => high,
            };
            self.position(dvec3(pick(0, low.x, high.x), pick(1, low.y, high.y), pick(2, low.z, high.z)))?;
        }
        const FACES: [[usize; 4]; 6] =
            [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        for face in FACES {
            let [a, b, c, d] = face.map(|corner| base + corner);
            writeln!(self.out, "f {a} {b} {c} {d}")?;
        }
        Ok(())
    }

    /// A shape as a grid of about `triangles` triangles.
    fn shape(&mut self, shape: &Shape, triangles: f64) -> io::Result<()> {
        const FEWEST: f64 = 6.0;
        let has_poles = shape.seam == Seam::Poles;
        // A quad is two triangles, but one where it touches a pole.
        let full_rows = (0.5 * triangles / shape.aspect).sqrt().round().max(FEWEST);
        let columns = (0.5 * triangles / full_rows).round().max(FEWEST);
        let rows = full_rows + f64::from(has_poles);
        let columns_of_points = columns as usize + usize::from(shape.seam == Seam::Open);
        // At a pole one point stands for its whole row.
        let rows_of_points = match shape.seam {
            Seam::Poles => rows as usize - 1,
            Seam::Torus => rows as usize,
            Seam::Open | Seam::Tube => rows as usize + 1,
        };
        let first_row = usize::from(has_poles);

        self.use_material(shape.material)?;
        let base = [self.positions + 1, self.normals + 1];
        for row in first_row..first_row + rows_of_points {
            for column in 0..columns_of_points {
                self.shape_point(shape, column as f64 / columns, row as f64 / rows)?;
            }
        }
        if has_poles {
            self.shape_point(shape, 0.0, 0.0)?;
            self.shape_point(shape, 0.0, 1.0)?;
        }

        let lower_pole = rows_of_points * columns_of_points;
        let (rows, columns) = (rows as usize, columns as usize);
        let index = |column: usize, row: usize| match (has_poles, row) {
            (true, 0) => lower_pole,
            (true, row) if row == rows => lower_pole + 1,
            _ => {
                let row = (row - first_row) % rows_of_points;
                row * columns_of_points + column % columns_of_points
            }
        };
        for row in 0..rows {
            for column in 0..columns {
                let (right, above) = (column + 1, row + 1);
                let mut corners = vec![index(column, row), index(right, row)];
                corners.extend([index(right, above), index(column, above)]);
                corners.dedup();
                self.face(&corners, base, shape.is_smooth)?;
            }
        }
        Ok(())
    }

    fn shape_point(&mut self, shape: &Shape, u: f64, v: f64) -> io::Result<()> {
        self.position((shape.point)(u, v))?;
        if shape.is_smooth {
            // Differences are taken inside the square: at a pole, du vanishes.
            const STEP: f64 = 1e-4;
            let inside = |x: f64| x.clamp(2.0 * STEP, 1.0 - 2.0 * STEP);
            let (u, v) = (inside(u), inside(v));
            let du = (shape.point)(u + STEP, v) - (shape.point)(u - STEP, v);
            let dv = (shape.point)(u, v + STEP) - (shape.point)(u, v - STEP);
            let normal = du.cross(dv).normalize_or(DVec3::Y);
            self.normals += 1;
            writeln!(self.out, "vn {:.4} {:.4} {:.4}", normal.x, normal.y, normal.z)?;
        }
        Ok(())
    }

    fn face(&mut self, corners: &[usize], base: [usize; 2], smooth: bool) -> io::Result<()> {
        self.out.write_all(b"f")?;
        for corner in corners {
            write!(self.out, " {}", base[0] + corner)?;
            if smooth {
                write!(self.out, "//{}", base[1] + corner)?;
            }
        }
        self.out.write_all(b"\n")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_face_outwards() {
        const N: usize = 60;
        for shape in shapes().iter().filter(|shape| shape.seam != Seam::Open) {
            let point = |i: usize, j: usize| (shape.point)(i as f64 / N as f64, j as f64 / N as f64);
            let inside = (0..N).map(|j| point(0, j) + point(N / 2, j)).sum::<DVec3>() / 120.0;
            let volume = |i: usize, j: usize| {
                let [a, b, c, d] = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| point(i, j) - inside);
                a.dot(b.cross(c)) + a.dot(c.cross(d))
            };
            let cells = (0..N).flat_map(|i| (0..N).map(move |j| (i, j)));
            let volume: f64 = cells.map(|(i, j)| volume(i, j)).sum();
            assert!(volume > 0.0, "{} is inside out", shape.material);
        }
    }

    #[test]
    fn sheets_face_the_hall() {
        let normal = |point: fn(f64, f64) -> DVec3| {
            let [du, dv] = [point(0.9, 0.1), point(0.1, 0.9)].map(|end| end - point(0.1, 0.1));
            du.cross(dv)
        };
        assert!(normal(sand).y > 0.0);
        assert!(normal(curtain).z > 0.0);
    }
}
