// The board's own files, run by MicroPython: node firmware.mjs FOLDER_OF_NODE_MODULES SOCKET, the world at the socket's other end.
import fs from "node:fs";
import path from "node:path";
import { pathToFileURL, fileURLToPath } from "node:url";

const [modules, socket] = [process.argv[2], Number(process.argv[3])];
const here = path.dirname(fileURLToPath(import.meta.url));
const micropython = path.join(modules, "@micropython/micropython-webassembly-pyscript/micropython.mjs");
const { loadMicroPython } = await import(pathToFileURL(micropython));

const buffer = Buffer.alloc(65536);
let got = "";
globalThis.call_world = (text) => {
  fs.writeSync(socket, text + "\n");
  while (!got.includes("\n")) {
    const count = fs.readSync(socket, buffer);
    if (count === 0) process.exit(0); // the processor was started anew, or the world has ended
    got += buffer.toString("latin1", 0, count);
  }
  const end = got.indexOf("\n");
  const answer = got.slice(0, end);
  got = got.slice(end + 1);
  return answer;
};

// As much memory as an RP2040 leaves to MicroPython.
const mp = await loadMicroPython({ heapsize: 190 * 1024, linebuffer: true, stdout: (line) => console.error(line) });
const files = ["machine", "time", "usb"].map((name) => path.join(here, `${name}.py`));
files.push(...["parts", "board", "scpi", "main"].map((name) => path.join(here, "..", `${name}.py`)));
mp.FS.mkdirTree("/board"); // found before what comes with it, as a time of its own
for (const file of files) mp.FS.writeFile(`/board/${path.basename(file)}`, fs.readFileSync(file));
mp.runPython("import sys\nsys.path.insert(0, '/board')\nimport main\nmain.main()");
