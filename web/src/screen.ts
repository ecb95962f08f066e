/** Which of the two screens the address asks for. */
export const isKiosk: boolean = /^\/kiosk\/?$/.test(window.location.pathname);
