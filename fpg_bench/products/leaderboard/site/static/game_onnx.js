/* A policy.onnx in the browser: its protobuf read as far as a policy needs, for game_policy.js.
   fpgOnnx.read(bytes, form) gives { nodes, weights, state, noise, limit }, with the form of a policy from the page's data;
   an Error's message is one line for the visitor. All is inside of one function, whose text runs in a worker, too. */
"use strict";
const fpgOnnxCode = () => {
  const BROKEN = "This is not an ONNX file, or it is truncated.";
  const text = new TextDecoder("utf-8", { fatal: true });

  const shown = (name) => (name.length > 40 ? `${name.slice(0, 40)}…` : name);
  const refuse = (line) => {
    throw new Error(line);
  };

  /** The values of a message by field number: BigInts, or bytes of strings, messages and packed numbers. */
  function message(bytes) {
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length), fields = {};
    let at = 0;
    const varint = () => {
      let value = 0n, shift = 0n, byte;
      do {
        if (shift > 63n) refuse(BROKEN);
        byte = view.getUint8(at++);
        value |= BigInt(byte & 127) << shift;
        shift += 7n;
      } while (byte > 127);
      return value;
    };
    const part = (length) => {
      if (at + length > bytes.length) refuse(BROKEN);
      at += length;
      return bytes.subarray(at - length, at);
    };
    const READ = { 0: varint, 1: () => part(8), 2: () => part(Number(varint())), 5: () => part(4) };
    while (at < bytes.length) {
      const key = Number(varint());
      (fields[key >> 3] ??= []).push((READ[key & 7] ?? (() => refuse(BROKEN)))());
    }
    return fields;
  }

  const all = (fields, number) => fields[number] ?? [];
  const last = (fields, number) => all(fields, number).at(-1);
  const string = (fields, number) => text.decode(last(fields, number) ?? new Uint8Array());
  const int = (value) => Number(BigInt.asIntN(64, value ?? 0n));
  const float = (bytes) => new DataView(bytes.buffer, bytes.byteOffset, 4).getFloat32(0, true);

  /** A list of integers, packed or not. */
  function ints(values) {
    return values.flatMap((value) => (typeof value === "bigint" ? int(value) : all(message(repeated(value)), 1).map(int)));
  }

  /** Packed varints as a message of field 1. */
  function repeated(packed) {
    const out = [];
    let begins = true;
    for (const byte of packed) {
      if (begins) out.push(8);
      out.push(byte);
      begins = byte < 128;
    }
    return Uint8Array.from(out);
  }

  function floats(values) {
    return values.flatMap((bytes) => Array.from({ length: bytes.length / 4 }, (_, i) => float(bytes.subarray(4 * i, 4 * i + 4))));
  }

  const whole = (wide) => (fields, raw) => {
    if (!raw) return ints(all(fields, wide === 8 ? 7 : 5));
    const view = new DataView(raw.buffer, raw.byteOffset, raw.length);
    return Array.from({ length: raw.length / wide }, (_, i) => (wide === 8 ? Number(view.getBigInt64(8 * i, true)) : wide === 4 ? view.getInt32(4 * i, true) : view.getUint8(i)));
  };
  const KINDS = {
    1: (fields, raw) => Float32Array.from(raw ? floats([raw]) : floats(all(fields, 4))),
    6: whole(4), 7: whole(8), 9: whole(1),
  };

  function tensor(fields) {
    const name = string(fields, 8), kind = int(last(fields, 2)), shape = ints(all(fields, 1));
    if (int(last(fields, 14)) || fields[13]) refuse(`The data of tensor ${shown(name)} lie in another file; keep them in policy.onnx.`);
    if (!KINDS[kind]) refuse(`Tensor ${shown(name)} holds other numbers than those of a policy: float32, int64, int32 and bool.`);
    const data = KINDS[kind](fields, last(fields, 9));
    if (data.length !== shape.reduce((product, size) => product * size, 1)) refuse(BROKEN);
    return { shape, data };
  }

  const VALUES = { 1: (f) => float(last(f, 2)), 2: (f) => int(last(f, 3)), 3: (f) => string(f, 4), 4: (f) => tensor(message(last(f, 5))), 6: (f) => floats(all(f, 7)), 7: (f) => ints(all(f, 8)) };
  const KIND_OF = { 2: 1, 3: 2, 4: 3, 5: 4, 7: 6, 8: 7 }; // where a file names none: by the field that is there

  /** Name and value; one of another kind, as a subgraph, is not finite. */
  function attribute(fields) {
    const kind = int(last(fields, 20)) || KIND_OF[Object.keys(fields).find((number) => KIND_OF[number])];
    return [string(fields, 1), VALUES[kind]?.(fields) ?? NaN];
  }

  function node(fields) {
    const domain = string(fields, 7), op = string(fields, 4);
    return {
      op: domain && domain !== "ai.onnx" ? `${domain}.${op}` : op, inputs: all(fields, 1).map((name) => text.decode(name)),
      outputs: all(fields, 2).map((name) => text.decode(name)), attributes: all(fields, 5).map((one) => attribute(message(one))),
    };
  }

  /** Refuse an operator or an attribute that a policy may not have. */
  function check({ op, attributes }, { operators, defaults }) {
    if (!Object.hasOwn(operators, op)) refuse(`This page cannot play the operator ${shown(op)}; a submission may not have it, either.`);
    for (const [name, value] of attributes) {
      const place = `Operator ${op}: its attribute ${shown(name)}`;
      if (Object.hasOwn(defaults, name) ? value !== defaults[name] : !operators[op].includes(name)) refuse(`${place} is not played.`);
      if (typeof value !== "string" && ![value.data ? 0 : value].flat().every((number) => Math.abs(number) <= 2 ** 31)) refuse(`${place} is not finite, or larger than 2^31.`);
    }
  }

  /** Name and size of a row of an input or output; 0: the file does not say. */
  function value(fields) {
    const of = (parent, number) => message(last(parent, number) ?? new Uint8Array());
    const sizes = all(of(of(of(fields, 2), 1), 2), 1).map((one) => int(last(message(one), 1)));
    return [string(fields, 1), sizes.at(-1) ?? 0];
  }

  function model(bytes, form) {
    const file = message(bytes), graph = message(last(file, 7) ?? refuse(BROKEN)), parts = all(graph, 1);
    if (!parts.length) refuse(BROKEN);
    if (parts.length > form.nodes) refuse(`The policy holds ${parts.length} operators, at most ${form.nodes} are allowed.`);
    const nodes = parts.map((one) => node(message(one))), ends = nodes.reduce((sum, { inputs, outputs }) => sum + inputs.length + outputs.length, 0);
    if (ends > form.ends) refuse(`The policy's operators have ${ends} inputs and outputs in all, at most ${form.ends} are allowed.`);
    nodes.forEach((one) => check(one, form));
    const weights = Object.fromEntries(all(graph, 5).map((one) => message(one)).map((fields) => [string(fields, 8), tensor(fields)]));
    const fixed = new Set([...Object.keys(weights), ...nodes.flatMap(({ op, outputs }) => (op === "Constant" ? outputs : []))]);
    for (const { op, inputs } of nodes)
      if (/^(Reshape|Slice|Split|Squeeze|Unsqueeze|Reduce.*)$/.test(op) && inputs.slice(1).some((name) => name && !fixed.has(name))) refuse(`Operator ${op}: its sizes are computed in play; export with every size fixed but the batch.`);
    const named = (number) => new Map(all(graph, number).map((one) => value(message(one))));
    const versions = all(file, 8).map((one) => message(one)).filter((one) => ["", "ai.onnx"].includes(string(one, 1))).map((one) => int(last(one, 2)));
    return { nodes: nodes.map((one) => ({ ...one, attributes: Object.fromEntries(one.attributes) })), weights, inputs: named(11), outputs: named(12), version: versions[0] ?? 0 };
  }

  function read(bytes, form) {
    if (bytes.length > form.bytes) refuse("The file is larger than 5 MB, the most that a submission may have.");
    let file;
    try {
      file = model(bytes, form);
    } catch (error) {
      throw error instanceof RangeError || error instanceof TypeError ? new Error(BROKEN) : error;
    }
    const { nodes, weights, inputs, outputs, version } = file, [oldest, newest] = form.opsets, noise = inputs.get("noise") ?? 0, state = inputs.get("state") ?? 0;
    if (!(inputs.has("observation") && outputs.has("action"))) refuse("A policy needs the input observation and the output action.");
    if (inputs.get("observation") !== 15) refuse(`The policy observes ${inputs.get("observation")} numbers, not the 15 of the game.`);
    if (outputs.get("action") !== 9) refuse(`The policy answers with ${outputs.get("action")} numbers, not the nine of an action.`);
    if (inputs.has("state") && !(state > 0 && state <= form.multiply_adds && outputs.has("next_state"))) refuse("A policy with the input state needs its size, and the output next_state.");
    if (inputs.has("noise") && !(noise > 0 && noise <= form.noise)) refuse(`A policy takes ${form.noise} numbers of noise at most.`);
    if (!(version >= oldest && version <= newest)) refuse(`The file has version ${version} of ONNX's operators; this page plays ${oldest} to ${newest}.`);
    return { nodes, weights, state, noise, limit: { most: form.multiply_adds, weights: form.weights } };
  }

  return { read };
};
const fpgOnnx = fpgOnnxCode();
