// What @foxglove makes of messages of ROS 2: the reader of a schema, and its messages as JSON.
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";

export const readerOf = (definition) => new MessageReader(parse(definition, { ros2: true }));

// JSON has no NaN, no infinities, no -0 and no arrays of bytes: numbers that it lacks go as their names.
const written = (_, value) => {
  if (typeof value === "bigint") return value.toString();
  if (ArrayBuffer.isView(value)) return Array.from(value);
  if (typeof value === "number" && (!Number.isFinite(value) || Object.is(value, -0))) return { number: Object.is(value, -0) ? "-0.0" : String(value) };
  return value;
};

export const say = (what) => process.stdout.write(`${JSON.stringify(what, written)}\n`);
