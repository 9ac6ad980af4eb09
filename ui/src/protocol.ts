// What the server and the page say to each other. The types are the server's own.

import type { Code, ErrorBody } from "./generated/protocol";

export type * from "./generated/protocol";

/** A refusal of the server, or that it could not be reached. */
export type Failure = Omit<ErrorBody, "code"> & { code: Code | "lost" };
