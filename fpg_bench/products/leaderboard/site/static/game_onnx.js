/* A policy.onnx in the browser: its protobuf read as far as a policy needs, for game_policy.js.
   fpgOnnx.read(bytes) gives { nodes, weights, state }; an Error's message is one line for the visitor. */
"use strict";
const fpgOnnx = (() => {
  const MOST_BYTES = 5_000_000, OLDEST = 13; // as a submission may have; of the set of operators
  const BROKEN = "This is not an ONNX file, or it is truncated.";
  const text = new TextDecoder("utf-8", { fatal: true });

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

  const KINDS = {
    1: (fields, raw) => Float32Array.from(raw ? floats([raw]) : floats(all(fields, 4))),
    7: (fields, raw) => (raw ? Array.from({ length: raw.length / 8 }, (_, i) => Number(new DataView(raw.buffer, raw.byteOffset + 8 * i, 8).getBigInt64(0, true))) : ints(all(fields, 7))),
  };

  function tensor(fields) {
    const name = string(fields, 8), kind = int(last(fields, 2)), shape = ints(all(fields, 1));
    if (int(last(fields, 14)) || fields[13]) refuse(`The data of tensor ${name} lie in another file; keep them in policy.onnx.`);
    if (!KINDS[kind]) refuse(`Tensor ${name} holds neither float32 nor int64, which are the numbers that this page plays.`);
    const data = KINDS[kind](fields, last(fields, 9));
    if (data.length !== shape.reduce((product, size) => product * size, 1)) refuse(BROKEN);
    return { shape, data };
  }

  const VALUES = { 1: (f) => float(last(f, 2)), 2: (f) => int(last(f, 3)), 3: (f) => string(f, 4), 4: (f) => tensor(message(last(f, 5))), 6: (f) => floats(all(f, 7)), 7: (f) => ints(all(f, 8)) };
  const KIND_OF = { 2: 1, 3: 2, 4: 3, 5: 4, 7: 6, 8: 7 }; // where a file names none: by the field that is there

  function attribute(fields) {
    const kind = int(last(fields, 20)) || KIND_OF[Object.keys(fields).find((number) => KIND_OF[number])];
    return [string(fields, 1), VALUES[kind]?.(fields)]; // one of another kind, as a subgraph, belongs to an operator that is not played
  }

  function node(fields) {
    const domain = string(fields, 7), op = string(fields, 4);
    return {
      op: domain && domain !== "ai.onnx" ? `${domain}.${op}` : op, inputs: all(fields, 1).map((name) => text.decode(name)),
      outputs: all(fields, 2).map((name) => text.decode(name)), attributes: Object.fromEntries(all(fields, 5).map((one) => attribute(message(one)))),
    };
  }

  /** Name and size of a row of an input or output; 0: the file does not say. */
  function value(fields) {
    const of = (parent, number) => message(last(parent, number) ?? new Uint8Array());
    const sizes = all(of(of(of(fields, 2), 1), 2), 1).map((one) => int(last(message(one), 1)));
    return [string(fields, 1), sizes.at(-1) ?? 0];
  }

  function model(bytes) {
    const file = message(bytes), graph = message(last(file, 7) ?? refuse(BROKEN));
    const nodes = all(graph, 1).map((one) => node(message(one)));
    if (!nodes.length) refuse(BROKEN);
    const weights = Object.fromEntries(all(graph, 5).map((one) => message(one)).map((fields) => [string(fields, 8), tensor(fields)]));
    const named = (number) => Object.fromEntries(all(graph, number).map((one) => value(message(one))));
    const versions = all(file, 8).map((one) => message(one)).filter((one) => ["", "ai.onnx"].includes(string(one, 1)));
    return { nodes, weights, inputs: named(11), outputs: named(12), version: Math.max(0, ...versions.map((one) => int(last(one, 2)))) };
  }

  function read(bytes) {
    if (bytes.length > MOST_BYTES) refuse("The file is larger than 5 MB, the most that a submission may have.");
    let file;
    try {
      file = model(bytes);
    } catch (error) {
      throw error instanceof RangeError || error instanceof TypeError ? new Error(BROKEN) : error;
    }
    const { nodes, weights, inputs, outputs, version } = file;
    if (inputs.noise !== undefined) refuse("The policy takes the input noise, which this page does not draw; fpg-bench evaluate plays it.");
    if (inputs.observation === undefined || outputs.action === undefined) refuse("A policy needs the input observation and the output action.");
    if (inputs.observation && inputs.observation !== 15) refuse(`The policy observes ${inputs.observation} numbers, not the 15 of the game.`);
    if (outputs.action && outputs.action !== 9) refuse(`The policy answers with ${outputs.action} numbers, not the nine of an action.`);
    if (inputs.state !== undefined && !(inputs.state && outputs.next_state !== undefined)) refuse("A policy with the input state needs its size, and the output next_state.");
    const unknown = [...new Set(nodes.map(({ op }) => op).filter((op) => !fpgPolicy.OPERATORS.includes(op)))];
    if (unknown.length) refuse(`This page cannot play the operator${unknown.length > 1 ? "s" : ""} ${unknown.join(", ")}; fpg-bench evaluate may.`);
    if (version < OLDEST) refuse(`The file has version ${version} of ONNX's operators; this page plays ${OLDEST} and later.`);
    return { nodes, weights, state: inputs.state ?? 0 };
  }

  return { read };
})();
