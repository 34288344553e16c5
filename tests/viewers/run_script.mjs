// node run_script.mjs LAYOUT.json RECORDING's messages as JSON lines on stdin: what the layout's user script makes of each
// message of its topic, translated and run as Foxglove does: TypeScript without its types, one call a message.
import { readFileSync } from "node:fs";
import ts from "typescript";

import { say } from "./decoded.mjs";

const [script] = Object.values(JSON.parse(readFileSync(process.argv[2], "utf8")).userNodes);
const { outputText, diagnostics } = ts.transpileModule(script.sourceCode, { compilerOptions: { module: "es2022", target: "es2022" }, reportDiagnostics: true });
if (diagnostics.length) throw new Error(ts.formatDiagnostics(diagnostics, { getCanonicalFileName: (f) => f, getCurrentDirectory: () => "", getNewLine: () => "\n" }));
const { default: call, inputs, output } = await import(`data:text/javascript,${encodeURIComponent(outputText)}`);
const revived = (_, value) => (value?.number ? Number(value.number) : value);
for (const line of readFileSync(0, "utf8").trim().split("\n")) {
  const { topic, message } = JSON.parse(line, revived);
  if (inputs.includes(topic)) say({ topic: output, message: call({ topic, message, receiveTime: { sec: 0, nsec: 0 } }) });
}
