// SPDX-License-Identifier: Apache-2.0
// The messages that page and server exchange, as types. `requests.py` checks requests by the same fields.

/** A value of a parameter. */
export type Value = number | boolean | string | number[];
export type Values = Record<string, any>;
/** A parameter of the rig, of its control or of the node. */
export type Descriptor = { name: string, type: string, unit: string, description: string, min: number | null, max: number | null, usual: [number, number] | null, zero: string, units: string[], read_only: boolean, choices: string[], group: string, first: { place: number, title: string, term: string, symbol: string } | null, value: any };
/** A recording of the list. */
export type ListedRecording = { name: string, start: number | null, duration: number | null, size: number, files: number, whole: boolean };
export type Preset = { name: string, title: string, description: string, values: Values };
export type Change = { time: number | null, kind: 'stretch' | 'change' | 'reset', values: Values, preset: string };
export type ControllerReport = { text: string, level: string, age: number | null };
export type Score = { seconds: number, x_rms: number, x_max: number, impacts: number, actuator_energy: number };
export type Layout = { kind: number, header: number, counts: number, instants: number, flags: Record<string, number>, tables: Record<string, string[]> };

/** Messages of the server. A field with `?` is there in some of its modes only. */
export type Hello = { type: 'hello', version: string, mode: 'live' | 'player' | 'in_page', rig: string, bag: string, parameters: Descriptor[], preset?: string, frame: Layout, rigs: string[], recordings: ListedRecording[], presets: Preset[], ros?: boolean, designs?: boolean, address?: string, steers: boolean, start?: number, duration?: number, changes?: Change[] };
export type Status = { type: 'status', state: 'running' | 'paused' | 'lagging' | 'doubled' | 'gone' | 'ended' | 'other_version', text: string, time?: number | null };
export type Parameters = { type: 'parameters', time: number | null, kind: 'stretch' | 'change' | 'reset', values: Values, preset: string };
export type Diagnostics = { type: 'diagnostics', level: string, kind: string, message: string, verdict: string, agreement: string, controller: ControllerReport | null };
export type Numbers = { type: 'numbers', natural_frequency_hz: number, damping_ratio: number, frequency_ratio: number, static_amplitude: number | null, mass_ratio: number, gap: number, impacts_per_cycle?: number | null, energy_per_cycle?: number | null, x_max_ratio?: number | null, score: Score | null };
export type Orbit = { type: 'orbit', found: boolean, text: string, kind: string, complete?: boolean, others?: object[], label?: string, stable?: boolean, viable?: boolean, reason?: string, x_max?: number, x_max_ratio?: number | null, multipliers?: [number, number][], cycles?: number, stops?: number[], period?: number, basis?: string, impacts?: { phase: number, x: number, stop: number, velocity_after: number, damper_velocity_after: number }[], t_zero?: number | null, t?: number[], phase?: number[], x?: number[], z?: number[], y?: number[], relative_velocity?: number[] };
export type Branch = { label?: string, gap: number[], x_max_ratio: number[], stable: boolean[], viable: boolean[] };
export type Special = { gap: number, x_max_ratio: number, kind: string, stable: boolean };
export type Curve = { type: 'gap_curve', gap?: number, x_max_ratio?: number | null, branches: Branch[], special?: Special[], optimum?: { gap: number, x_max_ratio: number, bound: string } | null, text: string };
export type TheoryFailed = { type: 'theory_failed', text: string };
export type Rigs = { type: 'rigs', list: string[] };
export type RecordingsList = { type: 'recordings', list: ListedRecording[] };
export type WhatIf = { type: 'what_if', on: boolean, done: boolean, text: string, until?: number | null, values?: Values, totals?: Record<string, Record<string, number>> };
export type CompareDone = { type: 'compare_done', recording: string, ok: boolean, url: string, text: string };
export type Notice = { type: 'notice', text: string };
export type SeekDone = { type: 'seek_done', time: number };
export type AnswerMessage = { type: 'answer', id: number | string | null, ok: boolean, reason: string, values?: Values, field?: string, design?: Record<string, any> };
export type ServerMessage = Hello | Status | Parameters | Diagnostics | Numbers | Orbit | Curve | TheoryFailed | Rigs | RecordingsList | WhatIf | CompareDone | Notice | SeekDone | AnswerMessage;

/** Requests of the page. */
export type ViewRequest = { type: 'view', window: number, rate: number };
export type SetRequest = { type: 'set', values: Values };
export type BeginRequest = { type: 'begin', values: Values };
export type ServiceRequest = { type: 'service', name: 'pause' | 'reset' | 'step' | 'step_to_impact' };
export type StructureRequest = { type: 'structure', values: Values };
export type CompareRequest = { type: 'compare', recording: string, on: boolean };
export type PlayRequest = { type: 'play', speed: number };
export type SeekRequest = { type: 'seek', time: number };
export type JumpRequest = { type: 'jump', to: string, direction: number };
export type WhatIfRequest = { type: 'what_if', values: Values | null };
export type Request = ViewRequest | SetRequest | BeginRequest | ServiceRequest | StructureRequest | CompareRequest | PlayRequest | SeekRequest | JumpRequest | WhatIfRequest;
export type Answer = { ok: boolean, reason: string, values?: Values, field?: string, design?: Record<string, any> };

/** What is new of the motion: rows of each table one after the other, with times from the end of the frame on. */
export type Frame = { end: number, epoch: number, paused: boolean, replace: boolean, replace_ghost: boolean } & Record<string, any>;
