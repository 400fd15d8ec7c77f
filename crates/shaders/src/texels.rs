//! Buffers that are read by texels. A kernel is compiled to read the scene from storage buffers; here its loads become
//! fetches from uniform texel buffers, which software devices read faster. So a kernel is built, and kept, once for both.

use std::collections::HashMap;

use rspirv::dr::{Instruction, Module, Operand};
use rspirv::spirv::{Capability, Decoration, Dim, ImageFormat, Op, StorageClass};

use crate::ids::{decorations, id_of};

/// A buffer of vectors of whole numbers.
struct Words {
    /// The type of one.
    vector: u32,
    components: u32,
}

/// Binds those buffers of a descriptor set that are arrays of vectors of `uint` as uniform texel buffers, and fetches texels
/// where their words were read.
///
/// # Errors
/// When the module does something else with one of them than to load from it.
pub fn fetch_texels(module: &mut Module, set: u32) -> Result<(), String> {
    let buffers = buffers_of(module, set);
    if buffers.is_empty() {
        return Ok(());
    }
    let mut bound = module.header.as_ref().ok_or("a module has a header")?.bound;
    let mut new_id = || {
        bound += 1;
        bound - 1
    };
    let (image, sampled) = (new_id(), new_id());
    let texel = declare(module, &buffers, image, sampled, &mut new_id)?;
    let constants: HashMap<u32, u32> = module.types_global_values.iter().filter_map(constant).collect();
    // By the pointer to a word, or to a component of it: the buffer, the place of the word, and the component.
    let mut places: HashMap<u32, (u32, Operand, Option<u32>)> = HashMap::new();
    for block in module.functions.iter().flat_map(|function| &function.blocks) {
        for chain in block.instructions.iter().filter(|i| is_chain(i)) {
            let buffer = id_of(&chain.operands[0]);
            if !buffers.contains_key(&buffer) {
                continue;
            }
            let component = match &chain.operands[2..] {
                [_] => None,
                [_, component] => Some(*constants.get(&id_of(component)).ok_or("a component is not a constant")?),
                _ => return Err("a buffer is not an array of vectors".to_owned()),
            };
            let pointer = chain.result_id.ok_or("a chain has a result")?;
            places.insert(pointer, (buffer, chain.operands[2].clone(), component));
        }
    }
    for block in module.functions.iter_mut().flat_map(|function| &mut function.blocks) {
        let mut code = Vec::with_capacity(block.instructions.len());
        for instruction in block.instructions.drain(..) {
            let is_place = instruction.result_id.is_some_and(|id| places.contains_key(&id));
            let pointer = instruction.operands.first().and_then(Operand::id_ref_any);
            let place = pointer.and_then(|pointer| places.get(&pointer));
            match (instruction.class.opcode, place) {
                _ if is_place => {}
                (Op::Load, Some((buffer, place, component))) => {
                    let (loaded, texels) = (new_id(), new_id());
                    let of = |op, kind, id, operands| Instruction::new(op, Some(kind), Some(id), operands);
                    code.push(of(Op::Load, sampled, loaded, vec![Operand::IdRef(*buffer)]));
                    code.push(of(Op::Image, image, texels, vec![Operand::IdRef(loaded)]));
                    let fetch = |id| of(Op::ImageFetch, texel, id, vec![Operand::IdRef(texels), place.clone()]);
                    let result = instruction.result_id.ok_or("a load has a result")?;
                    let kind = instruction.result_type.ok_or("a load has a type")?;
                    let words = &buffers[buffer];
                    if component.is_none() && words.components == 4 {
                        code.push(fetch(result));
                        continue;
                    }
                    let fetched = new_id();
                    code.push(fetch(fetched));
                    let fetched = Operand::IdRef(fetched);
                    code.push(match component {
                        Some(place) => {
                            of(Op::CompositeExtract, kind, result, vec![fetched, Operand::LiteralBit32(*place)])
                        }
                        None => {
                            let first = (0..words.components).map(Operand::LiteralBit32);
                            let operands = [fetched.clone(), fetched].into_iter().chain(first).collect();
                            of(Op::VectorShuffle, words.vector, result, operands)
                        }
                    });
                }
                (op, _) => {
                    let uses = |operand: &Operand| {
                        operand.id_ref_any().is_some_and(|id| places.contains_key(&id) || buffers.contains_key(&id))
                    };
                    if instruction.operands.iter().any(uses) {
                        return Err(format!("a buffer that is read by texels is used by {op:?}"));
                    }
                    code.push(instruction);
                }
            }
        }
        block.instructions = code;
    }
    module.header.as_mut().ok_or("a module has a header")?.bound = bound;
    Ok(())
}

/// The storage buffers of a set that are arrays of vectors, by their variables.
fn buffers_of(module: &Module, set: u32) -> HashMap<u32, Words> {
    let definitions: HashMap<u32, &Instruction> =
        module.types_global_values.iter().filter_map(|i| Some((i.result_id?, i))).collect();
    let sets = decorations(module, Decoration::DescriptorSet);
    let mut buffers = HashMap::new();
    for variable in &module.types_global_values {
        let is_buffer = variable.class.opcode == Op::Variable
            && variable.operands[0] == Operand::StorageClass(StorageClass::StorageBuffer);
        let Some(id) = variable.result_id.filter(|id| is_buffer && sets.get(id) == Some(&set)) else { continue };
        // A pointer to a block of one array without end, of vectors.
        let inner = |of: &Instruction, place: usize| {
            let id = of.operands.get(place).and_then(Operand::id_ref_any)?;
            definitions.get(&id).copied()
        };
        let pointer = variable.result_type.and_then(|id| definitions.get(&id).copied());
        let array = pointer.and_then(|pointer| inner(pointer, 1)).and_then(|block| inner(block, 0));
        let vector = array.filter(|array| array.class.opcode == Op::TypeRuntimeArray).and_then(|array| inner(array, 0));
        let Some(vector) = vector.filter(|vector| vector.class.opcode == Op::TypeVector) else { continue };
        if let (Some(vector), [_, Operand::LiteralBit32(components)]) = (vector.result_id, &vector.operands[..]) {
            buffers.insert(id, Words { vector, components: *components });
        }
    }
    buffers
}

/// Makes the variables those of uniform texel buffers. Returns the type of a texel.
fn declare(
    module: &mut Module,
    buffers: &HashMap<u32, Words>,
    image: u32,
    sampled: u32,
    new_id: &mut impl FnMut() -> u32,
) -> Result<u32, String> {
    let globals = &mut module.types_global_values;
    let uint = globals
        .iter()
        .find(|i| i.class.opcode == Op::TypeInt && i.operands == [Operand::LiteralBit32(32), Operand::LiteralBit32(0)])
        .and_then(|i| i.result_id)
        .ok_or("a buffer has no whole numbers")?;
    let of_four = [Operand::IdRef(uint), Operand::LiteralBit32(4)];
    let known = globals.iter().find(|i| i.class.opcode == Op::TypeVector && i.operands == of_four);
    let texel = known.and_then(|i| i.result_id);
    let texel = texel.unwrap_or_else(|| {
        let id = new_id();
        globals.push(Instruction::new(Op::TypeVector, None, Some(id), of_four.to_vec()));
        id
    });
    let pointer = new_id();
    let [of_buffer, sampled_image] = [1, 0].map(Operand::LiteralBit32);
    let zero = || Operand::LiteralBit32(0);
    globals.push(Instruction::new(
        Op::TypeImage,
        None,
        Some(image),
        vec![
            Operand::IdRef(uint),
            Operand::Dim(Dim::DimBuffer),
            sampled_image,
            zero(),
            zero(),
            of_buffer,
            Operand::ImageFormat(ImageFormat::Unknown),
        ],
    ));
    globals.push(Instruction::new(Op::TypeSampledImage, None, Some(sampled), vec![Operand::IdRef(image)]));
    let class = || Operand::StorageClass(StorageClass::UniformConstant);
    globals.push(Instruction::new(Op::TypePointer, None, Some(pointer), vec![class(), Operand::IdRef(sampled)]));
    let is_buffer = |i: &Instruction| i.result_id.is_some_and(|id| buffers.contains_key(&id));
    let variables: Vec<Instruction> = globals.iter().filter(|i| is_buffer(i)).cloned().collect();
    // Behind their new types.
    globals.retain(|i| !is_buffer(i));
    globals.extend(variables.into_iter().map(|variable| Instruction {
        result_type: Some(pointer),
        operands: vec![class()],
        ..variable
    }));
    // Of a buffer's decorations its place remains.
    module.annotations.retain(|i| match &i.operands[..] {
        [Operand::IdRef(id), Operand::Decoration(which), ..] if buffers.contains_key(id) => {
            matches!(which, Decoration::DescriptorSet | Decoration::Binding)
        }
        _ => true,
    });
    let capability = Operand::Capability(Capability::SampledBuffer);
    if !module.capabilities.iter().any(|i| i.operands.first() == Some(&capability)) {
        module.capabilities.push(Instruction::new(Op::Capability, None, None, vec![capability]));
    }
    Ok(texel)
}

fn is_chain(instruction: &Instruction) -> bool {
    matches!(instruction.class.opcode, Op::AccessChain | Op::InBoundsAccessChain)
}

fn constant(instruction: &Instruction) -> Option<(u32, u32)> {
    match (instruction.class.opcode, &instruction.operands[..]) {
        (Op::Constant, [Operand::LiteralBit32(value)]) => Some((instruction.result_id?, *value)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use rspirv::binary::Assemble as _;
    use rspirv::dr::Builder;

    use super::*;
    use crate::kernel::BindingKind;
    use crate::reflection::Reflection;
    use crate::small;

    /// `buffer words { uvecN words[]; }` in set 0.
    fn words(b: &mut Builder, components: u32) -> (u32, u32) {
        let uint = b.type_int(32, 0);
        let vector = b.type_vector(uint, components);
        let [array, block] = [(); 2].map(|()| b.id());
        b.type_runtime_array_id(Some(array), vector);
        b.type_struct_id(Some(block), [array]);
        b.decorate(array, Decoration::ArrayStride, [Operand::LiteralBit32(4 * components)]);
        b.member_decorate(block, 0, Decoration::Offset, [Operand::LiteralBit32(0)]);
        b.member_name(block, 0, "words");
        b.name(block, "Block");
        let pointer = b.type_pointer(None, StorageClass::StorageBuffer, block);
        let variable = b.variable(pointer, None, StorageClass::StorageBuffer, None);
        b.decorate(variable, Decoration::DescriptorSet, [Operand::LiteralBit32(0)]);
        b.decorate(variable, Decoration::Binding, [Operand::LiteralBit32(3)]);
        b.name(variable, "words");
        (variable, vector)
    }

    /// A kernel that reads a word, and a component of one.
    fn reader(components: u32) -> Module {
        let mut b = small::builder();
        let (variable, vector) = words(&mut b, components);
        let uint = b.type_int(32, 0);
        let [to_vector, to_uint] = [vector, uint].map(|of| b.type_pointer(None, StorageClass::StorageBuffer, of));
        let [zero, one, seven] = [0, 1, 7].map(|value| b.constant_bit32(uint, value));
        small::main(&mut b, |b| {
            let word = b.access_chain(to_vector, None, variable, [zero, seven]).expect("a block is open");
            b.load(vector, None, word, None, []).expect("a block is open");
            let component = b.access_chain(to_uint, None, variable, [zero, seven, one]).expect("a block is open");
            b.load(uint, None, component, None, []).expect("a block is open");
        });
        b.module()
    }

    #[test]
    fn loads_become_fetches() {
        for components in [2, 4] {
            let mut module = reader(components);
            fetch_texels(&mut module, 0).expect("it only loads");
            let ops: Vec<Op> = module.functions[0].blocks[0].instructions.iter().map(|i| i.class.opcode).collect();
            let fetch = [Op::Load, Op::Image, Op::ImageFetch];
            let whole: &[Op] = if components == 4 { &[] } else { &[Op::VectorShuffle] };
            assert_eq!(ops, [&fetch[..], whole, &fetch, &[Op::CompositeExtract, Op::Return]].concat());
            let reflection = Reflection::of(&module).expect("the host knows texel buffers");
            let [binding] = &reflection.bindings[..] else { panic!("one binding") };
            assert_eq!((binding.kind, binding.binding), (BindingKind::UniformTexelBuffer, 3));
            assert!(binding.reads && !binding.writes);
        }
    }

    #[test]
    fn other_sets_stay_and_other_uses_are_told() {
        let mut module = reader(4);
        fetch_texels(&mut module, 1).expect("nothing is to be done");
        assert_eq!(module.assemble(), reader(4).assemble());
        let mut b = small::builder();
        let (variable, vector) = words(&mut b, 4);
        let uint = b.type_int(32, 0);
        let pointer = b.type_pointer(None, StorageClass::StorageBuffer, vector);
        let zero = b.constant_bit32(uint, 0);
        small::main(&mut b, |b| {
            let word = b.access_chain(pointer, None, variable, [zero, zero]).expect("a block is open");
            let loaded = b.load(vector, None, word, None, []).expect("a block is open");
            b.store(word, loaded, None, []).expect("a block is open");
        });
        let error = fetch_texels(&mut b.module(), 0).expect_err("it stores");
        assert!(error.contains("Store"), "{error}");
    }
}
