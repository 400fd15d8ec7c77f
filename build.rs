//! Compiles every kernel of `shaders/` to SPIR-V and writes the kernel table; and the probes of
//! `tests/shaders/`, kernels that let the tests call single functions, what `shaders/facts/` measures a device by, the
//! kernels of the self-test and those of the examples, each into a table of its own.
//!
//! Each `NAME.comp` is compiled once; its specialization constants make of it what a render needs. From the SPIR-V itself
//! come the bindings, their access, the push-constant size and the block layouts that the tests
//! compare with the Rust structs. Every shader error is reported before the build fails. Every arithmetic is tried on
//! every kernel; the host puts one into a kernel when it builds it. The crate `raywave-shaders` has what is done to
//! SPIR-V; here is what is done to GLSL.

use std::collections::HashSet;
use std::fmt::Write as _;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::{env, fs, process, thread};

use raywave_shaders::{
    Arithmetic, BuiltModule, Form, Forms, Kernel, Library, Reflection, SWITCHES, Switch, Table, checks, deflate,
    fetch_texels, lower, passes,
};
use rspirv::binary::Assemble;
use rspirv::dr::Module;

#[allow(dead_code, reason = "the build needs only the tables")]
#[path = "src/constants.rs"]
mod constants;

use constants::{Specialization, SpecializationConstant};

/// Libraries of functions that the host puts in place of a kernel's operations, with the names of their statics.
const LIBRARIES: [(&str, &str); 2] =
    [("PORTABLE", "shaders/arithmetic/portable.glsl"), ("HOSTILE", "tests/shaders/hostile.glsl")];

/// Kernels that have a form in which the rays of a subgroup traverse a tree together: `NAME_packets`.
const IN_PACKETS: [&str; 4] = ["bounce", "connect", "extend", "traversal"];

/// Where the kernels' own functions lie, and then what the self-test's kernels share, and probes.
const INCLUDES: [&str; 3] = ["shaders/include", SELFTEST, PROBES];

/// The folder of the self-test's kernels.
const SELFTEST: &str = "shaders/selftest";

/// The probes' folder. A packaged source need not have it.
const PROBES: &str = "tests/shaders";
/// Kernels that measure what a device is like.
const FACTS: &str = "shaders/facts";
/// Kernels of the examples.
const EXAMPLES: &str = "examples/shaders";

fn main() {
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    let version = process::Command::new(env::var_os("RUSTC").expect("cargo sets RUSTC")).arg("--version").output();
    let version = version.map(|output| String::from_utf8_lossy(&output.stdout).trim().to_owned());
    println!("cargo::rustc-env=RAYWAVE_RUSTC_VERSION={}", version.unwrap_or_default());
    for source in ["shaders", PROBES, EXAMPLES, "src/constants.rs"] {
        println!("cargo::rerun-if-changed={source}");
    }
    let [(portable, portable_entry), (_, hostile_entry)] =
        LIBRARIES.map(|(name, path)| compile_library(name, path, &out).unwrap_or_else(|error| fail(&[error])));
    forget_other_scripts(&out);
    let texts = Texts { out: out.clone(), keys: Mutex::default() };
    let [kernels, probes] = ["shaders", PROBES].map(|folder| table(folder, Some(&portable), &texts));
    // These ask what the device itself does, or are not part of a render.
    let [facts, selftest, examples] = [FACTS, SELFTEST, EXAMPLES].map(|folder| table(folder, None, &texts));

    let tables = [&kernels, &probes, &facts, &selftest, &examples];
    let errors: Vec<String> = tables.into_iter().flat_map(|table| table.as_ref().err()).flatten().cloned().collect();
    let (Ok(kernels), Ok(probes), Ok(facts), Ok(selftest), Ok(examples)) = (kernels, probes, facts, selftest, examples)
    else {
        fail(&errors)
    };
    let write = |file: &str, text: String| fs::write(out.join(file), text).expect("OUT_DIR can be written");
    write("kernels.rs", kernels.kernels("KERNELS") + &kernels.structs("STRUCTS") + &portable_entry);
    write("probes.rs", probes.kernels("PROBES") + &hostile_entry);
    write("facts.rs", facts.kernels("FACTS"));
    write("selftest.rs", selftest.kernels("SELFTEST"));
    write("examples.rs", examples.kernels("EXAMPLES"));
    texts.forget_others();
}

fn fail(errors: &[String]) -> ! {
    eprintln!("{}", errors.join("\n"));
    process::exit(1);
}

/// The kernels of a folder, sorted by name, or what is wrong with each that does not compile.
fn table(folder: &str, portable: Option<&Library>, texts: &Texts) -> Result<Table, Vec<String>> {
    let mut paths: Vec<PathBuf> = match fs::read_dir(folder) {
        Ok(entries) => entries.map(|entry| entry.expect("a shader folder can be read").path()).collect(),
        Err(_) if folder == PROBES => Vec::new(),
        Err(error) => return Err(vec![format!("{folder}: {error}")]),
    };
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "comp"));
    paths.sort();

    // In threads: the kernels take half a minute one after the other.
    let built: Vec<_> = thread::scope(|scope| {
        let threads: Vec<_> =
            paths.iter().map(|path| scope.spawn(move || build_kernel(path, portable, texts))).collect();
        threads.into_iter().map(|thread| thread.join().expect("a kernel that does not compile is an error")).collect()
    });
    let (mut table, mut errors) = (Table::default(), Vec::new());
    for (path, built) in paths.iter().zip(built) {
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        match built {
            Ok(built) => {
                table.add(&name, &built, false);
                if IN_PACKETS.contains(&&*name) {
                    table.add(&format!("{name}_packets"), &built, true);
                }
            }
            Err(error) => errors.push(error),
        }
    }
    if errors.is_empty() { Ok(table) } else { Err(errors) }
}

fn build_kernel(path: &Path, portable: Option<&Library>, texts: &Texts) -> Result<BuiltModule, String> {
    let compiler = shaderc::Compiler::new().expect("the shaderc compiler starts");
    let source = fs::read_to_string(path).expect("a listed shader can be read");
    let options = kernel_options();
    let text = preprocess(&compiler, path, &source, &options)?;
    let file = &texts.file_of(&text);
    let mut module = match kept(file, &text) {
        Some(module) => module,
        None => {
            let module = compile(&compiler, path, &source, &options)?;
            check(&module, portable).map_err(|error| format!("{}: {error}", path.display()))?;
            keep(file, &text, &module);
            module
        }
    };
    let wrong = |error| format!("{}: {error}", path.display());
    let reflection = Reflection::of(&module).map_err(wrong)?;
    let mut texels = module.clone();
    fetch_texels(&mut texels, Kernel::SCENE_SET).map_err(wrong)?;
    let by_texels = Reflection::of(&texels).map_err(wrong)?;
    // For profilers that show sources.
    if !has_source() {
        module.debug_names.clear();
    }
    let (file, bytes) = (file.with_extension("zlib"), deflate(&module.assemble()));
    fs::write(&file, &bytes).expect("OUT_DIR can be written");
    Ok(BuiltModule { file, size: bytes.len(), reflection, by_texels })
}

/// The preprocessed texts of this build, and where their modules are kept.
struct Texts {
    out: PathBuf,
    keys: Mutex<HashSet<u64>>,
}

impl Texts {
    /// The file of the module of that text.
    fn file_of(&self, text: &str) -> PathBuf {
        let mut hasher = DefaultHasher::new();
        text.hash(&mut hasher);
        let key = hasher.finish();
        self.keys.lock().expect("nobody panics here").insert(key);
        self.out.join(format!("{key:016x}.spv"))
    }

    /// Removes what earlier builds kept of texts that are no more.
    fn forget_others(&self) {
        let keys = self.keys.lock().expect("nobody panics here");
        for path in fs::read_dir(&self.out).expect("OUT_DIR can be read").flatten().map(|entry| entry.path()) {
            let key = path.file_stem().and_then(|stem| u64::from_str_radix(stem.to_str()?, 16).ok());
            if key.is_some_and(|key| !keys.contains(&key)) {
                fs::remove_file(path).expect("OUT_DIR can be written");
            }
        }
    }
}

/// A library, and the text of the static that holds it.
fn compile_library(name: &str, path: &str, out: &Path) -> Result<(Library, String), String> {
    let compiler = shaderc::Compiler::new().expect("the shaderc compiler starts");
    // A packaged source need not have the tests'.
    let source = fs::read_to_string(path).unwrap_or_else(|_| "#version 460\nvoid main() {}\n".to_owned());
    // The optimizer would leave no function.
    let options = compile_options(shaderc::OptimizationLevel::Zero);
    let artifact = compiler
        .compile_into_spirv(&source, shaderc::ShaderKind::Compute, path, "main", Some(&options))
        .map_err(|error| error.to_string())?;
    let mut module = rspirv::dr::load_words(artifact.as_binary()).map_err(|error| format!("{path}: {error}"))?;
    // Names are what functions are found by; the source text is of no use.
    passes::remove_source(&mut module);
    let file = out.join(format!("{name}.spv"));
    fs::write(&file, to_bytes(&module)).expect("OUT_DIR can be written");
    let entry = format!("/// SPIR-V of `{path}`.\npub static {name}: &[u8] = include_bytes!({file:?});\n");
    Ok((Library::new(module), entry))
}

fn to_bytes(module: &Module) -> Vec<u8> {
    module.assemble().iter().flat_map(|word| word.to_ne_bytes()).collect()
}

/// Fails where a kernel that renders counts invocations by another workgroup size than the host's, or an arithmetic has
/// no form of an operation of it, or leaves one to the driver.
fn check(module: &Module, portable: Option<&Library>) -> Result<(), String> {
    let Some(portable) = portable else { return Ok(()) };
    if checks::counts_invocations_without_the_constant(module, workgroup_size_id()) {
        return Err("its code reads a workgroup size that is not the constant which the host sets".to_owned());
    }
    for form in [Form::Native, Form::ByFma, Form::ByIntegers] {
        let arithmetic = Arithmetic::Portable(Forms { division: form, reciprocal: form, root: form });
        lower(&mut module.clone(), arithmetic, portable, None)
            .map_err(|error| format!("{error}; see docs/numerics.md"))?;
    }
    Ok(())
}

fn compile_options(level: shaderc::OptimizationLevel) -> shaderc::CompileOptions<'static> {
    let mut options = shaderc::CompileOptions::new().expect("shaderc options start");
    options.set_target_env(shaderc::TargetEnv::Vulkan, shaderc::EnvVersion::Vulkan1_2 as u32);
    options.set_optimization_level(level);
    // Keeps the names that libraries are searched by, and that the reflection and the layout tests read.
    options.set_generate_debug_info();
    options.set_warnings_as_errors();
    options
}

fn kernel_options() -> shaderc::CompileOptions<'static> {
    let mut options = compile_options(shaderc::OptimizationLevel::Performance);
    options.set_include_callback(|requested, _, _, _| {
        if let Some(content) = generated(requested) {
            return Ok(shaderc::ResolvedInclude { resolved_name: requested.to_owned(), content });
        }
        let found = INCLUDES.iter().map(|folder| format!("{folder}/{requested}")).find(|path| Path::new(path).exists());
        let resolved_name = found.ok_or_else(|| format!("{requested} is in none of {INCLUDES:?}"))?;
        let content = fs::read_to_string(&resolved_name).map_err(|error| format!("{resolved_name}: {error}"))?;
        Ok(shaderc::ResolvedInclude { resolved_name, content })
    });
    options
}

/// A kernel's text with its includes.
fn preprocess(
    compiler: &shaderc::Compiler,
    path: &Path,
    source: &str,
    options: &shaderc::CompileOptions<'_>,
) -> Result<String, String> {
    let path = path.to_string_lossy();
    let artifact = compiler.preprocess(source, &path, "main", Some(options)).map_err(|error| error.to_string())?;
    let text = artifact.as_text();
    if checks::reads_workgroup_size_too_early(&text) {
        let wrong = "gl_WorkGroupSize is read before its declaration, where it is 1; include workgroup.glsl first";
        return Err(format!("{path}: {wrong}"));
    }
    Ok(text)
}

/// Compiles a kernel.
fn compile(
    compiler: &shaderc::Compiler,
    path: &Path,
    source: &str,
    options: &shaderc::CompileOptions<'_>,
) -> Result<Module, String> {
    let path = path.to_string_lossy();
    let artifact = compiler
        .compile_into_spirv(source, shaderc::ShaderKind::Compute, &path, "main", Some(options))
        .map_err(|error| error.to_string())?;
    let mut module = rspirv::dr::load_words(artifact.as_binary()).map_err(|error| format!("{path}: {error}"))?;
    passes::keep_loops_in_variables(&mut module);
    if !has_source() {
        passes::remove_source(&mut module);
    }
    Ok(module)
}

/// Whether kernels carry their source, by the feature `shader-source`.
fn has_source() -> bool {
    env::var_os("CARGO_FEATURE_SHADER_SOURCE").is_some()
}

/// The module that an earlier build made of this very text; `None` where there is none.
fn kept(file: &Path, text: &str) -> Option<Module> {
    let same = fs::read_to_string(file.with_extension("glsl")).is_ok_and(|kept| kept == text);
    let bytes = fs::read(file).ok().filter(|_| same)?;
    rspirv::dr::load_bytes(bytes).ok()
}

/// Keeps a module for [`kept`].
fn keep(file: &Path, text: &str, module: &Module) {
    fs::write(file, to_bytes(module)).expect("OUT_DIR can be written");
    fs::write(file.with_extension("glsl"), text).expect("OUT_DIR can be written");
}

/// Forgets what is kept, unless the same build script made it with the same library: what they do to a module is no part
/// of its text.
fn forget_other_scripts(out: &Path) {
    let script = env::current_exe().and_then(fs::read).expect("a build script can read itself");
    let portable = fs::read(out.join("PORTABLE.spv")).expect("the library was just written");
    let mut hasher = DefaultHasher::new();
    (script, portable, env::var_os("CARGO_FEATURE_SHADER_SOURCE")).hash(&mut hasher);
    let (file, stamp) = (out.join("stamp"), hasher.finish().to_string());
    if fs::read_to_string(&file).is_ok_and(|kept| kept == stamp) {
        return;
    }
    for entry in fs::read_dir(out).expect("OUT_DIR can be read").flatten() {
        if entry.path().extension().is_some_and(|extension| extension == "glsl") {
            fs::remove_file(entry.path()).expect("OUT_DIR can be written");
        }
    }
    fs::write(file, stamp).expect("OUT_DIR can be written");
}

/// The text of an include that is written here, from what Rust says.
fn generated(include: &str) -> Option<String> {
    match include {
        "constants.glsl" => Some(glsl_constants()),
        "specialization_constants.glsl" => Some(glsl_specialization_constants()),
        "switches.glsl" => Some(glsl_switches()),
        "listed_triangles.glsl" => Some(glsl_listed_triangles()),
        _ => None,
    }
}

fn glsl_constants() -> String {
    constants::GLSL.iter().fold(String::new(), |mut text, (name, value)| {
        writeln!(text, "#define {name} {value}u").expect("strings grow");
        text
    })
}

/// A declaration of each specialization constant, under its meaning. The size of a workgroup is declared by
/// `workgroup.glsl`, in the syntax that GLSL has for it alone, and has its id here.
fn glsl_specialization_constants() -> String {
    Specialization::TABLE.iter().enumerate().fold(String::new(), |mut text, (id, constant)| {
        let SpecializationConstant { name, rust_type, default, meaning } = constant;
        let glsl_name = name.to_uppercase();
        writeln!(text, "//{meaning}").expect("strings grow");
        let declared = if id as u32 == workgroup_size_id() {
            writeln!(text, "#define {glsl_name}_ID {id}u")
        } else if *rust_type == "bool" {
            writeln!(text, "layout(constant_id = {id}) const bool {glsl_name} = {};", *default != 0)
        } else {
            writeln!(text, "layout(constant_id = {id}) const uint {glsl_name} = {default}u;")
        };
        declared.expect("strings grow");
        text
    })
}

fn workgroup_size_id() -> u32 {
    let id = Specialization::TABLE.iter().position(|constant| constant.name == "workgroup_size");
    id.expect("the table has the size of a workgroup") as u32
}

/// The specialization constants that `raywave-shaders` sets.
fn glsl_switches() -> String {
    SWITCHES.iter().fold(String::new(), |mut text, Switch { name, id, meaning }| {
        writeln!(text, "// {meaning}\nlayout(constant_id = {id}) const bool {name} = false;").expect("strings grow");
        text
    })
}

/// The specialization constants that hold the vertices of listed triangles, and an initialiser of an
/// array of the vertices: GLSL has no constant arrays of specialization constants.
fn glsl_listed_triangles() -> String {
    let floats = 0..9 * constants::LISTED_TRIANGLES;
    let mut text = floats.fold(String::new(), |mut text, i| {
        let id = Specialization::TABLE.len() as u32 + i;
        writeln!(text, "layout(constant_id = {id}) const float LISTED_{i} = 0.0;").expect("strings grow");
        text
    });
    let vertices = (0..3 * constants::LISTED_TRIANGLES).map(|v| {
        let i = 3 * v;
        format!("vec3(LISTED_{i}, LISTED_{}, LISTED_{})", i + 1, i + 2)
    });
    let vertices: Vec<_> = vertices.collect();
    writeln!(text, "#define LISTED_VERTICES vec3[]({})", vertices.join(", ")).expect("strings grow");
    text
}
