// Frames of an update, read afresh from protocol/README.md: COBS(kind, source, body, crc16) 0x00, with bodies in postcard.
import { crc32 } from '../words.mjs';

const UPDATE = 0x50, CRC_START = 0xffff, CRC_POLYNOMIAL = 0x1021;
export const UPDATED = 0x51;
const ERRORS = ['running', 'absent', 'board', 'length', 'not-begun', 'order', 'block', 'incomplete', 'checksum', 'not-checked', 'on-trial', 'flash'];
const WITH_NUMBER = new Set(['board', 'length', 'order', 'incomplete', 'checksum']);

function crc16(bytes) {
  let crc = CRC_START;
  for (const byte of bytes) {
    crc ^= byte << 8;
    for (let bit = 0; bit < 8; bit++) crc = (crc & 0x8000 ? (crc << 1) ^ CRC_POLYNOMIAL : crc << 1) & 0xffff;
  }
  return [crc >> 8, crc & 0xff];
}

function cobs(bytes) {
  const out = [];
  let group = [];
  for (const byte of bytes) {
    if (byte !== 0) group.push(byte);
    if (byte === 0 || group.length === 254) {
      out.push(group.length + 1, ...group);
      group = [];
    }
  }
  return [...out, group.length + 1, ...group, 0];
}

function uncobs(frame) {
  const out = [];
  for (let at = 0; at < frame.length;) {
    const code = frame[at];
    out.push(...frame.slice(at + 1, at + code));
    at += code;
    if (code !== 255 && at < frame.length) out.push(0);
  }
  return out;
}

function number(value) {
  const out = [];
  for (let left = value >>> 0; ; left >>>= 7) {
    if (left < 128) return [...out, left];
    out.push((left & 127) | 128);
  }
}

function frame(body) {
  const content = [UPDATE, 0, ...body];
  return Uint8Array.from(cobs([...content, ...crc16(content)]));
}

export const request = {
  status: (length) => frame([0, ...number(length)]),
  begin: ({ board, length, crc }) => frame([1, ...number(board), ...number(length), ...number(crc)]),
  block: (offset, bytes) => frame([2, ...number(offset), ...number(crc32(bytes)), ...number(bytes.length), ...bytes]),
  check: () => frame([3]),
  swap: () => frame([4]),
  restart: () => frame([5]),
};

// What a frame says, or null where it is no answer of an update.
export function answer(encoded) {
  const raw = uncobs(encoded), content = raw.slice(0, -2);
  if (content[0] !== UPDATED) return null;
  if (crc16(content).join() !== raw.slice(-2).join()) throw new Error('an answer with a wrong checksum');
  let at = 2;
  const byte = () => content[at++];
  const integer = () => { let value = 0, shift = 0, next; do { next = byte(); value += (next & 127) * 2 ** shift; shift += 7; } while (next & 128); return value; };
  const outcome = (value) => {
    if (byte() === 0) return { ok: value() };
    const error = ERRORS[byte()];
    return WITH_NUMBER.has(error) ? { error, number: integer() } : { error };
  };
  switch (byte()) {
    case 0: {
      const [board, room, crc] = [integer(), integer(), integer()], onTrial = byte() === 1;
      const [ticksLeft, received] = [integer(), integer()], isChecked = byte() === 1;
      return { status: { board, room, crc, onTrial, ticksLeft, received, isChecked, refused: integer(), repeated: integer() } };
    }
    case 2: return outcome(integer);
    default: return outcome(() => null);
  }
}
