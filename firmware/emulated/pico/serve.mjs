// One Pico behind standard input and output, by its UART.
//
// usage: serve.mjs IMAGE UID [STORAGE]      as served.mjs says
import { serveKept } from './served.mjs';

serveKept({ usb: false });
