// One Pico whose USB connector is at a computer: its serial port at standard input and output.
//
// usage: serve-usb.mjs IMAGE UID [STORAGE]      as served.mjs says
import { serveKept } from './served.mjs';

serveKept({ usb: true });
