// One Pico whose USB connector is at a computer: its serial port at standard input and output.
//
// usage: serve-usb.mjs IMAGE UID      IMAGE: a path; UID: of its flash, 16 hexadecimal digits
import { pico, serve } from './served.mjs';
import { bytes } from './words.mjs';

const [image, uid] = process.argv.slice(2);
serve(pico({ image, uid: bytes(uid) }), { usb: true });
