//! raywave's arithmetic: what a kernel computes is the same on every device, to the last bit.
//!
//! Vulkan says what sums, differences and products of floats are, and leaves much else to the driver: how a quotient
//! or a root is rounded, in which order a dot product is summed, whether a cross product is fused. In place of all
//! that [`Arithmetic::Portable`] puts functions of `shaders/arithmetic/portable.glsl`. `docs/numerics.md` has the rules.

use std::collections::HashSet;

use rspirv::dr::{Instruction, Module, Operand};
use rspirv::spirv::{Decoration, GlslStd450Op, Op};

use crate::ids::{function_id, names};
use crate::link::{Library, Values, link};

/// How kernels compute with floats.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arithmetic {
    /// By rules that leave nothing to the driver.
    Portable(Forms),
    /// In the driver's way where Vulkan leaves one, without contraction: all kernels on one device agree.
    Native,
    /// The driver may also fuse and reorder.
    Contracted,
}

/// What portable quotients and roots are made of: what a device is proved to round right, it does itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Forms {
    /// Quotients.
    pub division: Form,
    /// Quotients of 1.
    pub reciprocal: Form,
    /// Square roots.
    pub root: Form,
}

/// How a correctly rounded quotient or root is had.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Form {
    /// By the device's own instruction.
    Native,
    /// From the device's by fused multiplication and addition.
    ByFma,
    /// From the device's by integers.
    ByIntegers,
}

impl Forms {
    /// For a device of which nothing is known.
    pub const CAREFUL: Self = Self { division: Form::ByIntegers, reciprocal: Form::ByIntegers, root: Form::ByIntegers };
    /// For a device whose own instructions round right.
    pub const NATIVE: Self = Self { division: Form::Native, reciprocal: Form::Native, root: Form::Native };
}

/// Puts the operations of an arithmetic in place of a kernel's.
///
/// `driver` has functions `driver_NAME` that stand for what is left to the driver then.
///
/// # Errors
/// When the kernel has an operation for which there is no portable form.
pub fn lower(
    module: &mut Module,
    arithmetic: Arithmetic,
    library: &Library,
    driver: Option<&Library>,
) -> Result<(), String> {
    if let Arithmetic::Portable(forms) = arithmetic {
        link(module, library, |instruction, values| portable_form(instruction, values, forms), makes_guesses)?;
        let left = left_to_the_driver(module, forms);
        if !left.is_empty() {
            return Err(format!("the driver may compute {} in its own way", left.join(", ")));
        }
    }
    if let Some(driver) = driver {
        link(module, driver, driver_form, |name| name.starts_with("driver_"))?;
    }
    if arithmetic != Arithmetic::Contracted {
        forbid_contraction(module);
    }
    Ok(())
}

/// Functions whose names say of what they make a right answer begin with the driver's.
fn makes_guesses(function: &str) -> bool {
    function.contains("_by_")
}

const ONE: u32 = 0x3f80_0000;

/// The function that stands for an instruction, if the driver is not to be trusted with it.
fn portable_form(instruction: &Instruction, values: &Values, forms: Forms) -> Option<&'static str> {
    let pick = |form, by_fma, by_integers| match form {
        Form::Native => None,
        Form::ByFma => Some(by_fma),
        Form::ByIntegers => Some(by_integers),
    };
    match instruction.class.opcode {
        Op::FDiv if values.is_constant(&instruction.operands[0], ONE) => {
            pick(forms.reciprocal, "portable_reciprocal_by_fma", "portable_reciprocal_by_integers")
        }
        Op::FDiv => pick(forms.division, "portable_divide_by_fma", "portable_divide_by_integers"),
        Op::Dot => Some("portable_dot"),
        Op::IsNan => Some("portable_is_nan"),
        Op::IsInf => Some("portable_is_inf"),
        Op::ExtInst => match extended(instruction)? {
            GlslStd450Op::Sqrt => pick(forms.root, "portable_root_by_fma", "portable_root_by_integers"),
            GlslStd450Op::InverseSqrt => Some("portable_inverse_sqrt"),
            GlslStd450Op::Cross => Some("portable_cross"),
            GlslStd450Op::Length => Some("portable_length"),
            GlslStd450Op::Normalize => Some("portable_normalize"),
            GlslStd450Op::Reflect => Some("portable_reflect"),
            GlslStd450Op::FMix => Some("portable_mix"),
            GlslStd450Op::Fract => Some("portable_fract"),
            GlslStd450Op::FMin => Some("portable_min"),
            GlslStd450Op::FMax => Some("portable_max"),
            GlslStd450Op::FClamp => Some("portable_clamp"),
            GlslStd450Op::PackHalf2x16 => Some("portable_pack_half"),
            GlslStd450Op::UnpackHalf2x16 => Some("portable_unpack_half"),
            GlslStd450Op::UnpackSnorm2x16 => Some("portable_unpack_snorm"),
            _ => None,
        },
        _ => None,
    }
}

/// The function of a library that does what a driver may.
fn driver_form(instruction: &Instruction, _: &Values) -> Option<&'static str> {
    use GlslStd450Op::*;
    Some(match (instruction.class.opcode, extended(instruction)) {
        (Op::FAdd, _) => "driver_add",
        (Op::FSub, _) => "driver_subtract",
        (Op::FMul | Op::VectorTimesScalar, _) => "driver_multiply",
        (Op::FDiv, _) => "driver_divide",
        (Op::Dot, _) => "driver_dot",
        (Op::ExtInst, Some(Sqrt)) => "driver_sqrt",
        (Op::ExtInst, Some(InverseSqrt)) => "driver_inverse_sqrt",
        (Op::ExtInst, Some(Cross)) => "driver_cross",
        (Op::ExtInst, Some(Length)) => "driver_length",
        (Op::ExtInst, Some(Normalize)) => "driver_normalize",
        (Op::ExtInst, Some(Reflect)) => "driver_reflect",
        (Op::ExtInst, Some(FMix)) => "driver_mix",
        (Op::ExtInst, Some(UnpackSnorm2x16)) => "driver_unpack_snorm",
        _ => return None,
    })
}

/// The operation of GLSL's set that an instruction is.
fn extended(instruction: &Instruction) -> Option<GlslStd450Op> {
    match instruction.operands.get(1) {
        Some(Operand::LiteralExtInstInteger(number)) if instruction.class.opcode == Op::ExtInst => {
            GlslStd450Op::from_u32(*number)
        }
        _ => None,
    }
}

/// Operations of a module whose result Vulkan does not lay down, where the forms do not vouch for the device's: of
/// GLSL's set all but what is known to be exact, so that a new one is looked at before it is used.
fn left_to_the_driver(module: &Module, forms: Forms) -> Vec<String> {
    use GlslStd450Op::*;
    let names = names(module);
    let mut left = Vec::new();
    for function in &module.functions {
        if names.get(&function_id(function)).is_some_and(|name| makes_guesses(name)) {
            continue;
        }
        for instruction in function.all_inst_iter() {
            let native = |form| form == Form::Native;
            let is_exact = match (instruction.class.opcode, extended(instruction)) {
                (Op::ExtInst, Some(Sqrt)) => native(forms.root),
                (Op::ExtInst, operation) => operation.is_some_and(|operation| {
                    matches!(
                        operation,
                        FAbs | FSign
                            | SAbs
                            | SSign
                            | Floor
                            | Ceil
                            | Trunc
                            | RoundEven
                            | UMin
                            | UMax
                            | UClamp
                            | SMin
                            | SMax
                            | SClamp
                            | FindILsb
                            | FindSMsb
                            | FindUMsb
                    )
                }),
                (Op::FDiv, _) => native(forms.division) || native(forms.reciprocal),
                (
                    Op::Dot
                    | Op::IsNan
                    | Op::IsInf
                    | Op::FRem
                    | Op::FMod
                    | Op::OuterProduct
                    | Op::MatrixTimesVector
                    | Op::VectorTimesMatrix
                    | Op::MatrixTimesMatrix
                    | Op::MatrixTimesScalar
                    | Op::QuantizeToF16,
                    _,
                ) => false,
                _ => true,
            };
            if !is_exact {
                left.push(
                    extended(instruction).map_or(format!("{:?}", instruction.class.opcode), |o| format!("{o:?}")),
                );
            }
        }
    }
    left.sort();
    left.dedup();
    left
}

/// Decorates all float arithmetic NoContraction: two kernels that call the same function then compute the same bits,
/// and the watertight edge tests keep their signs.
fn forbid_contraction(module: &mut Module) {
    let arithmetic = |op| {
        matches!(
            op,
            Op::FAdd
                | Op::FSub
                | Op::FMul
                | Op::FDiv
                | Op::FNegate
                | Op::Dot
                | Op::VectorTimesScalar
                | Op::MatrixTimesVector
                | Op::VectorTimesMatrix
                | Op::MatrixTimesScalar
                | Op::MatrixTimesMatrix
        )
    };
    let decorated = |i: &Instruction| match &i.operands[..] {
        [Operand::IdRef(id), Operand::Decoration(Decoration::NoContraction)] => Some(*id),
        _ => None,
    };
    let already: HashSet<u32> = module.annotations.iter().filter_map(decorated).collect();
    let ids = module.all_inst_iter().filter(|i| arithmetic(i.class.opcode)).filter_map(|i| i.result_id);
    let ids: Vec<u32> = ids.filter(|id| !already.contains(id)).collect();
    module.annotations.extend(ids.into_iter().map(|id| {
        let operands = vec![Operand::IdRef(id), Operand::Decoration(Decoration::NoContraction)];
        Instruction::new(Op::Decorate, None, None, operands)
    }));
}

#[cfg(test)]
mod tests {
    use rspirv::dr::Builder;

    use super::*;
    use crate::small;

    const BY_INTEGERS: Arithmetic = Arithmetic::Portable(Forms::CAREFUL);
    const NATIVE: Arithmetic = Arithmetic::Portable(Forms::NATIVE);

    /// Quotients by a guess of the driver's, and reciprocals that know none.
    fn library() -> Library {
        let mut b = small::builder();
        small::float_function(&mut b, "portable_divide_by_integers(f1;f1;", 2, |b, float, x| {
            b.f_div(float, None, x[0], x[1]).expect("a block is open")
        });
        small::float_function(&mut b, "portable_reciprocal_by_integers(f1;f1;", 2, |_, _, x| x[1]);
        Library::new(b.module())
    }

    fn function(code: impl FnOnce(&mut Builder, u32, &[u32]) -> u32) -> Module {
        let mut b = small::builder();
        small::float_function(&mut b, "f(f1;f1;", 2, code);
        b.module()
    }

    fn quotient() -> Module {
        function(|b, float, x| b.f_div(float, None, x[0], x[1]).expect("a block is open"))
    }

    fn count(function: &rspirv::dr::Function, op: Op) -> usize {
        function.all_inst_iter().filter(|i| i.class.opcode == op).count()
    }

    fn uncontracted(module: &Module) -> usize {
        let decorates = |i: &&Instruction| i.operands.contains(&Operand::Decoration(Decoration::NoContraction));
        module.annotations.iter().filter(decorates).count()
    }

    #[test]
    fn a_device_that_rounds_right_divides_itself() {
        let mut module = quotient();
        lower(&mut module, NATIVE, &library(), None).expect("it may");
        assert_eq!(module.functions.len(), 1);
        assert_eq!(count(&module.functions[0], Op::FDiv), 1);
    }

    #[test]
    fn another_gives_a_guess_to_a_function_of_the_library() {
        let mut module = quotient();
        lower(&mut module, BY_INTEGERS, &library(), None).expect("the library has the form");
        assert_eq!(count(&module.functions[0], Op::FDiv), 0);
        assert_eq!(count(&module.functions[0], Op::FunctionCall), 1);
        assert_eq!(count(&module.functions[1], Op::FDiv), 1, "the guess");
    }

    #[test]
    fn reciprocals_have_a_form_of_their_own() {
        let mut b = small::builder();
        let float = b.type_float(32, None);
        let one = b.constant_bit32(float, ONE);
        small::float_function(&mut b, "f(f1;", 1, |b, float, x| {
            b.f_div(float, None, one, x[0]).expect("a block is open")
        });
        let mut module = b.module();
        lower(&mut module, BY_INTEGERS, &library(), None).expect("the library has the form");
        let names: Vec<String> = names(&module).into_values().filter(|name| name.starts_with("portable")).collect();
        assert_eq!(names, ["portable_reciprocal_by_integers(f1;f1;"]);
    }

    #[test]
    fn what_no_form_stands_for_is_an_error() {
        let mut b = small::builder();
        let set = b.ext_inst_import("GLSL.std.450");
        small::float_function(&mut b, "f(f1;", 1, |b, float, x| {
            let operands = [Operand::IdRef(x[0])];
            b.ext_inst(float, None, set, GlslStd450Op::Sin as u32, operands).expect("a block is open")
        });
        let mut module = b.module();
        lower(&mut module, Arithmetic::Native, &library(), None).expect("it may be the driver's");
        let error = lower(&mut module, NATIVE, &library(), None).expect_err("each driver has a sine of its own");
        assert!(error.contains("Sin"), "{error}");
    }

    #[test]
    fn products_and_sums_are_not_fused_unless_they_may_be() {
        let product = || {
            function(|b, float, x| {
                let product = b.f_mul(float, None, x[0], x[1]).expect("a block is open");
                b.f_add(float, None, product, x[0]).expect("a block is open")
            })
        };
        for (arithmetic, expected) in [(NATIVE, 2), (Arithmetic::Native, 2), (Arithmetic::Contracted, 0)] {
            let mut module = product();
            lower(&mut module, arithmetic, &library(), None).expect("they are exact");
            assert_eq!(uncontracted(&module), expected, "{arithmetic:?}");
            // Once is enough.
            lower(&mut module, arithmetic, &library(), None).expect("they are exact");
            assert_eq!(uncontracted(&module), expected, "{arithmetic:?}, again");
        }
    }
}
