//! Spectra as linear RGB, and the constants that plugins know by name, as the RGB variants of Mitsuba 3 have them.

use glam::DVec3;

use super::xml::{finite, words};

/// A spectrum: a number for all wavelengths, or numbers at wavelengths in nm, in ascending order, linear in between and zero
/// outside.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Spectrum {
    Uniform(f64),
    Curve(Vec<[f64; 2]>),
}

/// What a spectrum is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Role {
    /// A share of light, seen under D65; in [0, 1].
    Reflectance,
    /// A number of a medium, such as an index of refraction, seen under D65.
    Unbounded,
    /// Light itself.
    Emission,
}

impl Spectrum {
    /// Reads one number, or `wavelength:value` pairs.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut all = words(text);
        if let (Some(word), None) = (all.next(), all.next())
            && !word.contains(':')
        {
            return finite(word).map(Self::Uniform);
        }
        let pair = |word: &str| {
            let (wavelength, value) = word.split_once(':').ok_or_else(|| {
                format!("`{}` is no wavelength:value; correct the spectrum", crate::scene::text::excerpt(word))
            })?;
            Ok([finite(wavelength)?, finite(value)?])
        };
        Self::of(words(text).map(pair).collect::<Result<_, String>>()?)
    }

    /// Reads a file that has a wavelength and a value on each line.
    pub fn parse_lines(text: &str) -> Result<Self, (usize, String)> {
        let mut curve = Vec::new();
        for (line, text) in (1..).zip(text.lines()) {
            let text = text.split('#').next().unwrap_or_default();
            let numbers: Vec<f64> = words(text).map(finite).collect::<Result<_, _>>().map_err(|e| (line, e))?;
            match numbers[..] {
                [] => {}
                [wavelength, value] => curve.push([wavelength, value]),
                _ => return Err((line, "not a wavelength and a value; correct the line".to_owned())),
            }
        }
        Self::of(curve).map_err(|problem| (1, problem))
    }

    fn of(curve: Vec<[f64; 2]>) -> Result<Self, String> {
        if curve.len() < 2 {
            return Err("a spectrum needs two wavelengths or more; add them".to_owned());
        }
        match curve.iter().zip(&curve[1..]).all(|(a, b)| a[0] < b[0]) {
            true => Ok(Self::Curve(curve)),
            false => Err("wavelengths do not ascend; sort them".to_owned()),
        }
    }

    /// Its colour in linear sRGB, each channel at least 0; of a reflectance at most 1.
    ///
    /// A curve is weighted by the matching functions of the CIE 1931 standard observer, and by D65 where it is not light
    /// itself, so that white stays white. Light of the same power at all wavelengths is not white but a little red.
    pub fn rgb(&self, role: Role) -> DVec3 {
        let rgb = match self {
            Self::Uniform(value) if role == Role::Emission => *value * srgb(DVec3::ONE),
            Self::Uniform(value) => DVec3::splat(*value),
            Self::Curve(curve) => srgb(xyz(curve, role != Role::Emission)),
        };
        if role == Role::Reflectance { rgb.clamp(DVec3::ZERO, DVec3::ONE) } else { rgb.max(DVec3::ZERO) }
    }
}

/// XYZ of a curve, by the sum that Mitsuba 3 takes (`spectrum_list_to_srgb`).
fn xyz(curve: &[[f64; 2]], is_under_d65: bool) -> DVec3 {
    const STEPS: u32 = 1000;
    let (first, last) = (SHORTEST, SHORTEST + STEP * (OBSERVER.len() - 1) as f64);
    let mut sum = DVec3::ZERO;
    for step in 0..STEPS {
        let wavelength = first + f64::from(step) / f64::from(STEPS - 1) * (last - first);
        if wavelength < curve[0][0] || wavelength > curve[curve.len() - 1][0] {
            continue;
        }
        let next = curve.partition_point(|[known, _]| *known <= wavelength).clamp(1, curve.len() - 1);
        let [[w0, v0], [w1, v1]] = [curve[next - 1], curve[next]];
        let value = v0 + (wavelength - w0) / (w1 - w0) * (v1 - v0);
        let place = (wavelength - first) / STEP;
        let at = (place as usize).min(OBSERVER.len() - 2);
        let share = place - at as f64;
        let mix = |column: usize| OBSERVER[at][column] * (1.0 - share) + OBSERVER[at + 1][column] * share;
        let light = if is_under_d65 { mix(3) / D65_INTEGRAL } else { 1.0 };
        sum += DVec3::new(mix(0), mix(1), mix(2)) * value * light;
    }
    sum * (last - first) / (Y_INTEGRAL * f64::from(STEPS))
}

fn srgb(xyz: DVec3) -> DVec3 {
    let rows = [
        DVec3::new(3.240479, -1.537150, -0.498535),
        DVec3::new(-0.969256, 1.875991, 0.041556),
        DVec3::new(0.055648, -0.204043, 1.057311),
    ];
    DVec3::from_array(rows.map(|row| row.dot(xyz)))
}

/// The index of refraction that has that name.
pub(super) fn index_of_refraction(name: &str) -> Option<f64> {
    INDICES.iter().find(|(known, _)| known.eq_ignore_ascii_case(name)).map(|(_, index)| *index)
}

/// The complex index of refraction of that material, real and imaginary part.
pub(super) fn complex_index(name: &str) -> Option<[DVec3; 2]> {
    let of = |name: &str| METALS.iter().find(|(known, ..)| *known == name);
    let (_, eta, absorption) = of(name).or_else(|| of(name.strip_suffix("_palik")?))?;
    Some([DVec3::from(*eta), DVec3::from(*absorption)])
}

/// Names of all of them.
pub(super) fn names(of: &'static [(&'static str, f64)]) -> String {
    of.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ")
}

/// Indices of refraction near 589 nm and between 0 and 20 degrees Celsius (Hecht, Optics, fourth edition), by the names that
/// Mitsuba 3 has for them.
#[rustfmt::skip]
pub(super) const INDICES: &[(&str, f64)] = &[
    ("vacuum", 1.0),
    ("helium", 1.000036),
    ("hydrogen", 1.000132),
    ("air", 1.000277),
    ("carbon dioxide", 1.00045),
    ("water", 1.333),
    ("acetone", 1.36),
    ("ethanol", 1.361),
    ("carbon tetrachloride", 1.461),
    ("glycerol", 1.4729),
    ("benzene", 1.501),
    ("silicone oil", 1.52045),
    ("bromine", 1.661),
    ("water ice", 1.31),
    ("fused quartz", 1.458),
    ("pyrex", 1.47),
    ("acrylic glass", 1.49),
    ("polypropylene", 1.49),
    ("bk7", 1.5046),
    ("sodium chloride", 1.544),
    ("amber", 1.55),
    ("pet", 1.575),
    ("diamond", 2.419),
];

/// Complex indices of refraction: real and imaginary part in linear RGB, by the names that Mitsuba 3 has for them, each
/// also with `_palik`. They are what its RGB variants (3.9.1) make of spectra that were measured, most of them as in Palik,
/// Handbook of Optical Constants of Solids.
#[rustfmt::skip]
const METALS: &[(&str, [f64; 3], [f64; 3])] = &[
    ("a-C", [2.94405, 2.22714, 1.96816], [0.887465, 0.799299, 0.81529]),
    ("Ag", [0.155276, 0.116728, 0.138388], [4.82835, 3.12222, 2.1469]),
    ("Al", [1.6575, 0.880405, 0.521244], [9.22381, 6.2695, 4.837]),
    ("AlAs", [3.6053, 3.23294, 2.21632], [0.000679437, 0.0, 0.00751271]),
    ("AlSb", [0.0, 4.13937, 4.66925], [0.0, 0.0940091, 1.30057]),
    ("Au", [0.143036, 0.375307, 1.44205], [3.983, 2.38556, 1.60336]),
    ("Be", [4.18501, 3.18503, 2.78406], [3.83547, 3.01012, 2.86899]),
    ("Cr", [4.36967, 2.91651, 1.6549], [5.20655, 4.23131, 3.7547]),
    ("CsI", [2.1449, 1.70232, 1.66243], [0.0, 0.0, 0.0]),
    ("Cu", [0.201005, 0.92375, 1.10222], [3.91326, 2.45305, 2.14209]),
    ("Cu2O", [3.55177, 2.94987, 2.75188], [0.114207, 0.193897, 0.606134]),
    ("Cu_palik", [0.213229, 0.919715, 1.10241], [3.92187, 2.45733, 2.13658]),
    ("CuO", [3.24754, 2.44781, 2.21022], [0.52109, 0.570031, 0.722179]),
    ("d-C", [2.70872, 2.31883, 2.2289], [0.0, 0.0, 0.0]),
    ("Hg", [2.39894, 1.44003, 0.90957], [6.32759, 4.37192, 3.42176]),
    ("HgTe", [4.77904, 3.2312, 2.6599], [1.63161, 1.58081, 1.72929]),
    ("Ir", [3.0863, 2.08219, 1.61791], [5.59215, 4.06709, 3.26731]),
    ("K", [0.0640432, 0.0464098, 0.0381849], [2.1042, 1.34894, 0.913126]),
    ("Li", [0.265791, 0.195618, 0.220949], [3.54015, 2.31112, 1.66861]),
    ("MgO", [2.08958, 1.65072, 1.59488], [0.000000000004, 0.0, 0.000000000025]),
    ("Mo", [4.48397, 3.52513, 2.77631], [4.11144, 3.42083, 3.15061]),
    ("Na_palik", [0.0602694, 0.0561409, 0.0619884], [3.17927, 2.11249, 1.57904]),
    ("Nb", [3.42007, 2.79009, 2.39563], [3.44139, 2.73767, 2.57975]),
    ("Ni_palik", [2.3673, 1.66337, 1.46708], [4.49881, 3.05015, 2.34544]),
    ("Rh", [2.58579, 1.86022, 1.55426], [6.78226, 4.70299, 3.97607]),
    ("Se", [4.05831, 2.84294, 2.82085], [0.75405, 0.638444, 0.521808]),
    ("Se-e", [5.72285, 4.16574, 4.08134], [0.871136, 1.10516, 1.56532]),
    ("SiC", [3.17234, 2.52597, 2.47937], [0.000000753766, 0.0, 0.0000101925]),
    ("SnTe", [4.52425, 1.98164, 1.28159], [0.0, 0.0, 0.0]),
    ("Ta", [2.06272, 2.39294, 2.62793], [2.40836, 1.74149, 1.94703]),
    ("Te", [7.39023, 4.4821, 2.63711], [3.25602, 3.52706, 3.29205]),
    ("Te-e", [7.50891, 4.29643, 2.36999], [5.58393, 4.94721, 3.99759]),
    ("ThF4", [1.83071, 1.44223, 1.38765], [0.0, 0.0, 0.0]),
    ("TiC", [3.70053, 2.83742, 2.58229], [3.26564, 2.35159, 2.17279]),
    ("TiN", [1.64845, 1.15052, 1.37982], [3.36833, 1.9435, 1.10207]),
    ("TiO2", [3.45661, 2.80174, 2.90517], [0.000105265, 0.0, 0.000652887]),
    ("TiO2-e", [3.10656, 2.51317, 2.58244], [0.0000297516, 0.0, 0.000182698]),
    ("V_palik", [4.27758, 3.51295, 2.76107], [3.4913, 2.88945, 3.11152]),
    ("VC", [3.65757, 2.75274, 2.53267], [3.0683, 2.19869, 1.96319]),
    ("VN", [2.8656, 2.11919, 1.94009], [3.03224, 2.05612, 1.61631]),
    ("W", [4.37082, 3.30025, 2.99841], [3.50064, 2.60487, 2.27323]),
];

/// Of the first row of `OBSERVER`, nm.
const SHORTEST: f64 = 360.0;
/// Between rows, nm.
const STEP: f64 = 5.0;
/// Of the second column over wavelengths.
const Y_INTEGRAL: f64 = 106.750_259_399_414_06;
/// Of D65 times the second column, in units of `Y_INTEGRAL`.
const D65_INTEGRAL: f64 = 98.99741751876255;

/// The matching functions x, y and z of the CIE 1931 standard observer, and the power of the CIE's illuminant D65, 100 at
/// 560 nm.
#[rustfmt::skip]
const OBSERVER: &[[f64; 4]; 95] = &[
    [0.0001299, 0.000003917, 0.0006061, 46.6383],
    [0.0002321, 0.000006965, 0.001086, 49.3637],
    [0.0004149, 0.00001239, 0.001946, 52.0891],
    [0.0007416, 0.00002202, 0.003486, 51.0323],
    [0.001368, 0.000039, 0.006450001, 49.9755],
    [0.002236, 0.000064, 0.01054999, 52.3118],
    [0.004243, 0.00012, 0.02005001, 54.6482],
    [0.00765, 0.000217, 0.03621, 68.7015],
    [0.01431, 0.000396, 0.06785001, 82.7549],
    [0.02319, 0.00064, 0.1102, 87.1204],
    [0.04351, 0.00121, 0.2074, 91.486],
    [0.07763, 0.00218, 0.3713, 92.4589],
    [0.13438, 0.004, 0.6456, 93.4318],
    [0.21477, 0.0073, 1.0390501, 90.057],
    [0.2839, 0.0116, 1.3856, 86.6823],
    [0.3285, 0.01684, 1.62296, 95.7736],
    [0.34828, 0.023, 1.74706, 104.865],
    [0.34806, 0.0298, 1.7826, 110.936],
    [0.3362, 0.038, 1.77211, 117.008],
    [0.3187, 0.048, 1.7441, 117.41],
    [0.2908, 0.06, 1.6692, 117.812],
    [0.2511, 0.0739, 1.5281, 116.336],
    [0.19536, 0.09098, 1.28764, 114.861],
    [0.1421, 0.1126, 1.0419, 115.392],
    [0.09564, 0.13902, 0.8129501, 115.923],
    [0.05795001, 0.1693, 0.6162, 112.367],
    [0.03201, 0.20802, 0.46518, 108.811],
    [0.0147, 0.2586, 0.3533, 109.082],
    [0.0049, 0.323, 0.272, 109.354],
    [0.0024, 0.4073, 0.2123, 108.578],
    [0.0093, 0.503, 0.1582, 107.802],
    [0.0291, 0.6082, 0.1117, 106.296],
    [0.06327, 0.71, 0.07824999, 104.79],
    [0.1096, 0.7932, 0.05725001, 106.239],
    [0.1655, 0.862, 0.04216, 107.689],
    [0.2257499, 0.9148501, 0.02984, 106.047],
    [0.2904, 0.954, 0.0203, 104.405],
    [0.3597, 0.9803, 0.0134, 104.225],
    [0.4334499, 0.9949501, 0.008749999, 104.046],
    [0.5120501, 1.0, 0.005749999, 102.023],
    [0.5945, 0.995, 0.0039, 100.0],
    [0.6784, 0.9786, 0.002749999, 98.1671],
    [0.7621, 0.952, 0.0021, 96.3342],
    [0.8425, 0.9154, 0.0018, 96.0611],
    [0.9163, 0.87, 0.001650001, 95.788],
    [0.9786, 0.8163, 0.0014, 92.2368],
    [1.0263, 0.757, 0.0011, 88.6856],
    [1.0567, 0.6949, 0.001, 89.3459],
    [1.0622, 0.631, 0.0008, 90.0062],
    [1.0456, 0.5668, 0.0006, 89.8026],
    [1.0026, 0.503, 0.00034, 89.5991],
    [0.9384, 0.4412, 0.00024, 88.6489],
    [0.8544499, 0.381, 0.00019, 87.6987],
    [0.7514, 0.321, 0.0001, 85.4936],
    [0.6424, 0.265, 0.00004999999, 83.2886],
    [0.5419, 0.217, 0.00003, 83.4939],
    [0.4479, 0.175, 0.00002, 83.6992],
    [0.3608, 0.1382, 0.00001, 81.863],
    [0.2835, 0.107, 0.0, 80.0268],
    [0.2187, 0.0816, 0.0, 80.1207],
    [0.1649, 0.061, 0.0, 80.2146],
    [0.1212, 0.04458, 0.0, 81.2462],
    [0.0874, 0.032, 0.0, 82.2778],
    [0.0636, 0.0232, 0.0, 80.281],
    [0.04677, 0.017, 0.0, 78.2842],
    [0.0329, 0.01192, 0.0, 74.0027],
    [0.0227, 0.00821, 0.0, 69.7213],
    [0.01584, 0.005723, 0.0, 70.6652],
    [0.01135916, 0.004102, 0.0, 71.6091],
    [0.008110916, 0.002929, 0.0, 72.979],
    [0.005790346, 0.002091, 0.0, 74.349],
    [0.004109457, 0.001484, 0.0, 67.9765],
    [0.002899327, 0.001047, 0.0, 61.604],
    [0.00204919, 0.00074, 0.0, 65.7448],
    [0.001439971, 0.00052, 0.0, 69.8856],
    [0.0009999493, 0.0003611, 0.0, 72.4863],
    [0.0006900786, 0.0002492, 0.0, 75.087],
    [0.0004760213, 0.0001719, 0.0, 69.3398],
    [0.0003323011, 0.00012, 0.0, 63.5927],
    [0.0002348261, 0.0000848, 0.0, 55.0054],
    [0.0001661505, 0.00006, 0.0, 46.4182],
    [0.000117413, 0.0000424, 0.0, 56.6118],
    [0.00008307527, 0.00003, 0.0, 66.8054],
    [0.00005870652, 0.0000212, 0.0, 65.0941],
    [0.00004150994, 0.00001499, 0.0, 63.3828],
    [0.00002935326, 0.0000106, 0.0, 63.8434],
    [0.00002067383, 0.0000074657, 0.0, 64.304],
    [0.00001455977, 0.0000052578, 0.0, 61.8779],
    [0.00001025398, 0.0000037029, 0.0, 59.4519],
    [0.000007221456, 0.0000026078, 0.0, 55.7054],
    [0.000005085868, 0.0000018366, 0.0, 51.959],
    [0.000003581652, 0.0000012934, 0.0, 54.6998],
    [0.000002522525, 0.00000091093, 0.0, 57.4406],
    [0.000001776509, 0.00000064153, 0.0, 58.8765],
    [0.000001251141, 0.00000045181, 0.0, 60.3125],
];

#[cfg(test)]
mod tests {
    use super::*;

    /// Expectations are what Mitsuba 3.9.1 (scalar_rgb) makes of the same spectra.
    #[test]
    fn spectra_have_the_colours_of_mitsuba() {
        let close = |text: &str, role, expected: [f64; 3]| {
            let rgb = Spectrum::parse(text).expect("it is a spectrum").rgb(role);
            assert!(rgb.abs_diff_eq(DVec3::from(expected), 1e-3 * rgb.max_element()), "{text}: {rgb}");
        };
        close("400:0.78, 500:0.78, 600:0.78, 700:0.78", Role::Reflectance, [0.776367, 0.77981, 0.776029]);
        close(
            "400:0.092, 404:0.096, 452:0.101, 500:0.285, 520:0.472, 560:0.337, 600:0.16, 700:0.159",
            Role::Reflectance,
            [0.0972951, 0.385307, 0.113618],
        );
        close("400:0, 500:8, 600:15.6, 700:18.4", Role::Emission, [20.7108, 10.8546, 2.77115]);
        close("300:2, 900:3", Role::Emission, [3.08293, 2.28163, 2.02683]);
        close("360:1.5, 500:1.2, 830:0.2", Role::Unbounded, [0.765044, 1.07197, 1.33155]);
        close("2", Role::Emission, [2.40959, 1.89658, 1.81783]);
        close("0.3", Role::Reflectance, [0.3; 3]);
    }

    #[test]
    fn what_is_no_spectrum_is_refused() {
        for text in ["", "x", "400:1", "400:1, 400:2", "500:1 400:2", "400:nan, 500:1", "400;1 500;2"] {
            assert!(Spectrum::parse(text).is_err(), "{text}");
        }
        assert_eq!(
            Spectrum::parse_lines("# a\n400 1\n500 2 # b\n"),
            Spectrum::parse("400:1 500:2").map_err(|e| (0, e))
        );
        assert_eq!(Spectrum::parse_lines("400 1\n500\n").expect_err("half a pair").0, 2);
    }

    #[test]
    fn names_are_known() {
        assert_eq!(index_of_refraction("BK7"), Some(1.5046));
        assert_eq!(complex_index("Au_palik"), complex_index("Au"));
        assert!(complex_index("Na_palik").is_some() && complex_index("gold").is_none());
    }
}
