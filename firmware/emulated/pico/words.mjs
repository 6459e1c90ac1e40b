// What is said to a board and what its answers say: from the project's own host program (sim-host/examples/board_words.rs), so that these
// tests know no byte of the wire.
import { execFileSync, spawnSync } from 'node:child_process';
import path from 'node:path';
import { fileURLToPath } from 'node:url';

export const ROOT = path.resolve(path.dirname(fileURLToPath(import.meta.url)), '../../..');
const HOST = process.env.FUNNEL_HOST ?? path.join(ROOT, 'target/debug');
const PROGRAM = path.join(HOST, 'examples/board_words');

// The kinds of the wire's replies that tests wait for (protocol/README.md).
export const KIND = { identity: 0x41, configured: 0x43, report: 0x46, stored: 0x48, staged: 0x4c };

export const bytes = (hex) => Uint8Array.from(Buffer.from(hex, 'hex'));

// As zlib has it, which Node has had only since 20.15.
export function crc32(bytes) {
  let crc = ~0;
  for (const byte of bytes) {
    crc ^= byte;
    for (let bit = 0; bit < 8; bit++) crc = crc & 1 ? (crc >>> 1) ^ 0xedb88320 : crc >>> 1;
  }
  return ~crc >>> 0;
}

export function words(scenario, ...overrides) {
  return JSON.parse(execFileSync(PROGRAM, [path.join(ROOT, scenario), ...overrides], { maxBuffer: 1 << 28 }));
}

// What frames of a node say.
export function read(frames) {
  const input = frames.map((frame) => `${Buffer.from(frame).toString('hex')}\n`).join('');
  const { stdout, status, stderr } = spawnSync(PROGRAM, ['--read'], { input, maxBuffer: 1 << 28 });
  if (status !== 0) throw new Error(`board_words --read: ${stderr}`);
  return stdout.toString().trim().split('\n').map((line) => JSON.parse(line));
}
