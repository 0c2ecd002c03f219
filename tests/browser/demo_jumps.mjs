// Reads jumps (JSON lines of {robot, law, times}) on stdin and answers each with the page's numbers, its rod and foot at
// these times, and the height of its map. Arguments: folder of the page's modules, tolerance of a step.
import { createInterface } from "node:readline";
import { pathToFileURL } from "node:url";

const [, , folder, tolerance] = process.argv;
const { jumpNumbers, mapHeight, sampleJump } = await import(pathToFileURL(`${folder}/physics.js`));
for await (const line of createInterface({ input: process.stdin })) {
  const { times, ...jump } = JSON.parse(line), rows = sampleJump(jump, times, Number(tolerance));
  const track = { rod: rows.map((r) => r[0]), foot: rows.map((r) => r[1]) };
  console.log(JSON.stringify({ ...jumpNumbers(jump, Number(tolerance)), ...track, map_height_m: mapHeight(jump) }));
}
